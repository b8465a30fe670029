"""A client of Blender MCP's socket protocol: the headless endpoint, or the add-on in a window."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from legoworld.endpoint.message_frames import FramingError, MessageSplitter
from legoworld.errors import LegoWorldError, cause
from legoworld.files import Json
from legoworld.records.base import Record, RecordError, canonical, decode
from legoworld.records.endpoint import Answer, Command, Failure, Success

_BLOCK: Final = 1 << 16


class BlenderUnreachableError(LegoWorldError):
    """No Blender answers at the address, or it stopped answering."""

    code = "blender_unreachable"


class BlenderRefusedError(LegoWorldError):
    """Blender answered that it could not do what was asked."""

    code = "blender_refused"


@dataclass(frozen=True, kw_only=True)
class Address:
    """Where a Blender listens."""

    host: str = "127.0.0.1"
    port: int = 9876

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


class _Answer(Record, frozen=True, kw_only=True):
    """Either form of an answer."""

    status: Literal["success", "error"]
    result: Any = None
    message: str = ""


def _read(data: bytes) -> Answer:
    answer = decode(_Answer, data)
    if answer.status == "error":
        return Failure(message=answer.message)
    return Success(result=answer.result)


class BlenderConnection:
    """One command, one connection: a Blender that was started anew in between is found again."""

    def __init__(self, address: Address, *, time_s: float = 180.0) -> None:
        self.address = address
        self._time_s = time_s
        self._line: socket.socket | None = None

    def run(self, code: str) -> str:
        """Run Python in Blender; what it printed. BlenderRefusedError when it raised."""
        result = self.command("execute_code", {"code": code})
        printed = result.get("result") if isinstance(result, dict) else None
        return printed if isinstance(printed, str) else ""

    def workspace(self) -> Path | None:
        """The folder that an endpoint's Blender is confined to; None for a Blender without one.

        The endpoint itself says it, not the code in its Blender.
        """
        try:
            return Path(str(self.command("get_workspace", {})["workspace"]))
        except (BlenderRefusedError, LookupError, TypeError):
            return None

    def command(self, kind: str, parameters: Mapping[str, Json]) -> Any:
        """The result of one command. BlenderRefusedError where Blender answers with a failure."""
        message = canonical(Command(type=kind, params=dict(parameters)))
        answer = self._answer(message.encode())
        if isinstance(answer, Failure):
            raise BlenderRefusedError(
                f"Blender refused {kind}",
                found=answer.message,
                expected="success",
                next_step="look at the scene: the call may have been made in part",
            )
        return answer.result

    def interrupt(self) -> None:
        """Wait no longer for the running command, from another thread; Blender may finish it."""
        if line := self._line:
            with contextlib.suppress(OSError):  # it has just been answered
                line.shutdown(socket.SHUT_RDWR)

    def _answer(self, message: bytes) -> Answer:
        splitter = MessageSplitter()
        try:
            place = (self.address.host, self.address.port)
            with socket.create_connection(place, self._time_s) as line:
                self._line = line
                line.sendall(message)
                while data := line.recv(_BLOCK):
                    for answer in splitter.feed(data):
                        return _read(answer)
        except (OSError, FramingError, RecordError) as error:
            raise self._unreachable(cause(error)) from error
        finally:
            self._line = None
        raise self._unreachable("the connection ended without an answer")

    def _unreachable(self, found: str) -> BlenderUnreachableError:
        return BlenderUnreachableError(
            f"no Blender answers at {self.address}",
            found=found,
            expected="Blender MCP's socket",
            next_step="start `legoworld blender serve`, or the add-on's server in Blender",
        )
