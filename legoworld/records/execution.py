"""execution.json: how a scene program ended; and what its own process reports of it."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.verdict import Verdict

#: What a program's process does, in this order.
Stage = Literal["program", "export"]


class ProgramError(Record, frozen=True, kw_only=True):
    """The error that stopped a program; line: of the program itself, null where it has none."""

    type: str
    message: str
    line: Annotated[int, Meta(ge=1, lt=1 << 31)] | None


class Reason(Record, frozen=True, kw_only=True):
    """The parts of an error that left no scene; see LegoWorldError."""

    code: str = ""
    what: str = ""
    found: str = ""
    expected: str = ""
    next: str = ""


class ProgramReport(Record, frozen=True, kw_only=True):
    """What the program's process writes as it goes, and at its end.

    at: the stage that was begun last, null before any; ok: null until the process came to its end;
    reason: why there is no scene; error: what stopped the program; skipped: its own calls that were
    not made.
    """

    at: Stage | None = None
    ok: bool | None = None
    reason: Reason | None = None
    error: ProgramError | None = None
    skipped: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


class Protected(Record, frozen=True, kw_only=True):
    """What the program was kept from, and what another machine would have kept it from."""

    bubblewrap: str | None
    why_not: str | None
    holds: list[str]
    does_not_hold: list[str]


class ExecutionFile(Record, frozen=True, kw_only=True):
    """execution.json. files: sha256 by name; check: how scene.blend opened in another process."""

    schema_version: int | UnsetType = UNSET
    legoworld: str | UnsetType = UNSET
    bpy: str | UnsetType | None = UNSET
    program_sha256: str | UnsetType = UNSET
    status: Literal["complete", "stopped"]
    error: ProgramError | None = None
    files: dict[str, str]
    warnings: tuple[str, ...] = ()
    check: Verdict | UnsetType = UNSET
    sandbox: Protected | UnsetType = UNSET
