"""What a program's process says of the program's end: untrusted, so it is checked word by word."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.errors import one_line
from legoworld.records.base import RecordError, decode
from legoworld.records.scene_folder import ProgramError, ProgramReport, Reason

REPORT: Final = "report.json"
#: Printed on a line of its own when the program begins. A program can take its report away; what
#: is printed stays.
BEGUN: Final = "legoworld begins the program"
_MOST_BYTES: Final = 1 << 20
MOST_WARNINGS: Final = 200

#: A report is written whole: one that cannot be read was damaged by the program.
_DAMAGED: Final = ProgramReport(at="program")


def read_report(path: Path | None) -> ProgramReport:
    """The report in a file taken from a sandbox; one that says nothing where there is none.

    Every text in it is one line. What cannot be read is a program's doing, which had then begun.
    """
    if path is None:
        return ProgramReport()
    try:
        with path.open("rb") as stream:
            report = decode(ProgramReport, stream.read(_MOST_BYTES))
    except (OSError, RecordError):
        return _DAMAGED
    if report.ok is None:
        return ProgramReport(at=report.at or "program")
    return ProgramReport(
        at="export",
        ok=report.ok,
        reason=None if report.ok else _flat(report.reason or Reason()),
        error=report.error and _error(report.error),
        skipped=_lines(report.skipped),
        warnings=_lines(report.warnings),
    )


def _flat(reason: Reason) -> Reason:
    return Reason(**{key: one_line(getattr(reason, key)) for key in Reason.__struct_fields__})


def _error(error: ProgramError) -> ProgramError:
    return replace(error, type=one_line(error.type, 100), message=one_line(error.message, 300))


def _lines(texts: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(one_line(text) for text in texts[:MOST_WARNINGS])
