"""What a program's process says of the program's end: untrusted, so it is checked word by word."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from legoworld.errors import one_line

REPORT: Final = "report.json"
#: Printed on a line of its own when the program begins. A program can take its report away; what
#: is printed stays.
BEGUN: Final = "legoworld begins the program"
_MOST_BYTES: Final = 1 << 20
_MOST_WARNINGS: Final = 200
_STAGES: Final = ("program", "export")


@dataclass(frozen=True, kw_only=True)
class ProgramReport:
    """at: the last stage that was begun, None before any. reason: why there is no scene.

    done: whether the process came to its end; error: {"type", "message", "line"} of a program that
    was stopped by one.
    """

    at: str | None
    done: bool
    reason: dict[str, str] | None
    error: dict[str, Any] | None
    skipped: tuple[str, ...]
    warnings: tuple[str, ...]


_NOTHING: Final = ProgramReport(
    at=None, done=False, reason=None, error=None, skipped=(), warnings=()
)
#: A report is written whole: one that cannot be read was damaged by the program.
_DAMAGED: Final = replace(_NOTHING, at="program")


def read_report(path: Path | None) -> ProgramReport:
    """The report in a file taken from a sandbox; one that says nothing where there is none.

    What cannot be read is a program's doing, which had then begun.
    """
    if path is None:
        return _NOTHING
    try:
        with path.open("rb") as stream:
            value = json.loads(stream.read(_MOST_BYTES))
    except (OSError, ValueError, RecursionError):
        return _DAMAGED
    if not isinstance(value, dict):
        return _DAMAGED
    at = value.get("at")
    if "ok" not in value:
        return ProgramReport(
            at=at if at in _STAGES else "program", done=False, reason=None, error=None,
            skipped=(), warnings=(),
        )  # fmt: skip
    reason = value.get("reason")
    return ProgramReport(
        at="export",
        done=True,
        reason=_texts(reason) if value["ok"] is not True else None,
        error=_error(value.get("error")),
        skipped=_lines(value.get("skipped")),
        warnings=_lines(value.get("warnings")),
    )


def _texts(value: Any) -> dict[str, str]:
    """A LegoWorldError's reason, every part of it there and one line."""
    known = value if isinstance(value, dict) else {}
    return {
        key: one_line(str(known.get(key, "")))
        for key in ("code", "what", "found", "expected", "next")
    }


def _error(value: Any) -> dict[str, Any] | None:
    if not isinstance(value, dict):
        return None
    line = value.get("line")
    return {
        "type": one_line(str(value.get("type", "")), 100),
        "message": one_line(str(value.get("message", "")), 300),
        "line": line if type(line) is int and 0 < line < 1 << 31 else None,
    }


def _lines(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list):
        return ()
    return tuple(one_line(str(text)) for text in value[:_MOST_WARNINGS])
