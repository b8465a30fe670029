"""What passes through a Blender endpoint: a client's commands, and the words with its Blender."""

from __future__ import annotations

from typing import Any, Literal

from legoworld.records.base import Record

#: A JSON object of a client's: keys and values are whatever it sent.
Parameters = dict[str, Any]
Caller = Literal["agent", "plugin"]


class Command(Record, frozen=True, kw_only=True):
    """A message of Blender MCP's socket protocol: {"type": "execute_code", "params": {...}}."""

    type: str
    params: Parameters | None = None


class Success(Record, frozen=True, kw_only=True):
    """An answer of the protocol. result: a JSON value."""

    status: Literal["success"] = "success"
    result: Any


class Failure(Record, frozen=True, kw_only=True):
    """An answer of the protocol; for code that raised, message is JSON itself: `CodeError`."""

    status: Literal["error"] = "error"
    message: str


Answer = Success | Failure


class CodeError(Record, frozen=True, kw_only=True):
    """Why a client's code stopped, as the add-on says it."""

    exception_type: str
    message: str
    traceback: str


class BlenderRequest(Record, frozen=True, kw_only=True):
    """One request to the endpoint's Blender. time_s: after which the client's code is stopped."""

    kind: str
    params: Parameters
    time_s: float


class BlenderReply(Record, frozen=True, kw_only=True):
    """Its reply.

    error: set where the request failed; stopped: whether that was at its time limit; seconds: what
    the request itself took.
    """

    result: Any = None
    error: str | None = None
    stopped: bool = False
    seconds: float


class Checkpoint(Record, frozen=True, kw_only=True):
    """The scene after a call that changed it.

    ordinal: from 1, of the trial; sha256: of the .blend, its name in the store; call: the call it
    follows, from 1; at_s: since the trial began; kind: `live` is the open scene, `saved` a
    scene.blend that the agent saved itself.
    """

    ordinal: int
    sha256: str
    bytes: int
    call: int
    at_s: float
    kind: Literal["live", "saved"]


class Call(Record, frozen=True, kw_only=True):
    """One command that a client sent, and how it ended.

    number: from 1; code: of execute_code, else null; seconds: what Blender took; checkpoint: the
    ordinal of the last one that the call left, null where it changed nothing; by: who made it, the
    agent or the plugin that measures for it.
    """

    number: int
    command: str
    code: str | None
    at_s: float
    seconds: float
    status: Literal["success", "error", "crashed", "timeout"]
    said: str
    checkpoint: int | None
    by: Caller = "agent"
