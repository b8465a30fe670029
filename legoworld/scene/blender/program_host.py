"""The process of a scene program: it runs one program and ends.

It has no channel to legoworld: its report of the program's end is a file in the sandbox that the
program could have written itself. It is only used to describe how the program ended; the scene is
read by another process.
"""

from __future__ import annotations

import contextlib
import errno
import faulthandler
import json
import os
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError, WorkerMemoryError, printable
from legoworld.records.base import canonical, to_record
from legoworld.records.scene_folder import ProgramReport, Reason, Stage
from legoworld.scene.programs.report import BEGUN

#: How long before the time limit the program's line is printed.
_SAY_BEFORE_S: Final = 0.3
_FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def main() -> int:
    """Run sys.argv[1], a JSON object: program, output, report (paths), deadline (monotonic s)."""
    request = json.loads(sys.argv[1])
    # Where a crash or the time limit finds the program is on standard error.
    faulthandler.enable()
    left_s = request["deadline"] - time.monotonic() - _SAY_BEFORE_S
    faulthandler.dump_traceback_later(max(left_s, 0.01))
    report = Path(request["report"])

    def say(answer: ProgramReport) -> None:
        unfinished = report.with_name(f".{report.name}")
        with contextlib.suppress(OSError):  # a report that is not there is a verdict, too
            unfinished.write_text(printable(canonical(answer)), encoding="utf-8")
            unfinished.replace(report)  # whole, or the one before

    def begin(stage: Stage) -> None:
        if stage == "program":
            print(BEGUN, flush=True)
        say(ProgramReport(at=stage))

    say(_answer(Path(request["program"]), Path(request["output"]), begin))
    # Some add-ons and caches abort in Blender's own exit code; all results are written by now.
    os._exit(0)


def _answer(program: Path, output: Path, begin: Callable[[Stage], None]) -> ProgramReport:
    from legoworld.scene.blender.programs import execute_program

    try:
        return execute_program(program, output, begin)
    except LegoWorldError as error:
        return ProgramReport(ok=False, reason=to_record(Reason, error.reason()))
    except MemoryError:
        return ProgramReport(ok=False, reason=Reason(code=WorkerMemoryError.code))
    except Exception as error:  # noqa: BLE001  reported; the program may have broken anything
        traceback.print_exception(error)
        full = isinstance(error, OSError) and error.errno in _FULL
        text = f"{type(error).__name__}: {error}"
        return ProgramReport(ok=False, reason=Reason(code="full" if full else "export", found=text))


if __name__ == "__main__":
    sys.exit(main())
