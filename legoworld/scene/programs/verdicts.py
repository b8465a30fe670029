"""Why a scene program left no scene: said of the program, with what to change in it."""

from __future__ import annotations

import re
import signal
from pathlib import Path
from typing import Final

from legoworld import exit_codes
from legoworld.errors import LegoWorldError, one_line
from legoworld.scene.programs.report import BEGUN
from legoworld.workers.protections import SandboxUnavailableError
from legoworld.workers.sandbox import Ending, Limit, SandboxLimits

#: What faulthandler prints before the stack, in a crash and at the time limit.
_STACKS: Final = ("Fatal Python error", "Timeout (")


class ProgramCrashedError(LegoWorldError):
    """The program crashed Blender."""

    code = "program_crashed"


class ProgramEndedError(LegoWorldError):
    """The program ended its process before its scene could be exported."""

    code = "program_ended"


class ProgramLimitError(LegoWorldError):
    """The program was ended at a limit on memory, output, processes or disk."""

    code = "program_limit"


class ProgramTimeoutError(ProgramLimitError):
    """The program was still running at its time limit."""

    code = "program_timeout"
    status = "timeout"


class BlenderNotStartedError(LegoWorldError):
    """Blender ended before the program began."""

    code = "blender_not_started"
    exit_code = exit_codes.BLOCKED


class ProgramOutputError(LegoWorldError):
    """The program's output is not a scene."""

    code = "program_output"


def over_limit(
    ending: Ending, over: Limit, at: str | None, limits: SandboxLimits, program: Path
) -> ProgramLimitError:
    """The error of a program that was ended for a limit. at: the last stage that was begun."""
    if over == "time" and at is None and not _has_begun(ending):
        return ProgramTimeoutError(
            "the program did not begin",
            found=f"Blender was still starting after {limits.time_s:g} s",
            expected="a Blender that starts within the time limit",
            next_step="raise --time-limit, or wait until this machine has less to do",
        )
    if over == "time":
        return ProgramTimeoutError(
            "the program did not finish",
            found=f"still running after {limits.time_s:g} s{_at(ending, program)}",
            expected="a program that ends within the time limit",
            next_step="look for a loop that does not end, build less, or raise --time-limit",
        )
    gib, mib = limits.memory_bytes / 2**30, limits.output_bytes >> 20
    what, found, next_step = {
        "memory": (
            "the program used too much memory",
            f"more than {gib:g} GiB with the processes it started",
            "build less geometry (subdivision, arrays, particles), or raise --memory-limit",
        ),
        "output": (
            "the program printed too much",
            f"more than {mib} MiB; its last line: {_last_line(ending)}",
            "print less",
        ),
        "processes": (
            "the program started too many processes",
            f"more than {limits.processes} at once",
            "build the scene in the program's own process",
        ),
        "disk": (
            "the program wrote too much",
            f"more than {limits.disk_bytes / 2**30:g} GiB, or more files than are counted",
            "write fewer or smaller files",
        ),
    }[over]
    return ProgramLimitError(
        what, found=found, expected="a program within its limits", next_step=next_step
    )


def ended_early(ending: Ending, at: str | None, program: Path) -> LegoWorldError:
    """The error of a process that ended without the end of its report. at: its last stage."""
    code = ending.code or 0
    how = signal_name(-code) if code < 0 else f"exit code {code}"
    begun = at is not None or _has_begun(ending)
    if not begun and _last_line(ending).startswith("bwrap: "):
        return SandboxUnavailableError(
            "bubblewrap did not start the program",
            found=_last_line(ending),
            expected="a bubblewrap that starts Python",
            next_step="--sandbox limits runs the program without bubblewrap",
        )
    if not begun:
        return BlenderNotStartedError(
            "Blender did not start, and the program was not run",
            found=one_line(f"{how}; {_last_line(ending)}", 300),
            expected="a Blender that starts",
            next_step="a library Blender needs may be missing: `legoworld doctor` checks",
        )
    gone = "" if at else ", and its report is gone"
    if code >= 0:
        return ProgramEndedError(
            "the program ended its process, so nothing could be exported",
            found=one_line(f"{how}{gone}; its last line: {_last_line(ending)}", 300),
            expected="a program that comes to its end, or raises",
            next_step="take out os._exit and whatever ends Blender; sys.exit is understood",
        )
    doing = "while its scene was exported" if at == "export" else "in Blender"
    return ProgramCrashedError(
        f"the program crashed {doing}",
        found=one_line(f"{how}{_at(ending, program)}; its last line: {_last_line(ending)}", 300),
        expected="a program that comes to its end",
        next_step="change what the program does there; run it in Blender to see it crash",
    )


def _has_begun(ending: Ending) -> bool:
    """Whether Blender came so far that the program began, whatever became of its report."""
    return BEGUN in ending.first_output.splitlines()


def signal_name(number: int) -> str:
    """SIGSEGV for 11; the number itself where the system names none."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _at(ending: Ending, program: Path) -> str:
    """The program's line that ran last, where the stack is among its output."""
    start = max(ending.last_output.rfind(word) for word in _STACKS)
    if start < 0:
        return ""
    line = re.search(rf'File "{re.escape(str(program))}", line (\d+)', ending.last_output[start:])
    return f", at line {line[1]}" if line else ""


def _last_line(ending: Ending) -> str:
    """The last line printed before a stack that names no place and has no clock before it."""
    text = ending.last_output
    ends = [at for word in _STACKS if (at := text.rfind(word)) >= 0]
    lines = text[: min(ends)].splitlines() if ends else text.splitlines()
    lines = [
        x for x in lines
        if x.startswith("bwrap: ")
        or (x.strip() and not x[0].isdigit() and "/" not in x and x != BEGUN)
    ]  # fmt: skip
    return one_line(lines[-1], 150) if lines else "no message"
