"""A command that stops itself (SIGSTOP) at a moment of a test's choosing; also run as a program.

A test that kills or interrupts a command in the midst of its work has to find it there. Looking
often enough is a race that a busy machine loses; a command that waits there to be found is none.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from waiting import until

_TESTS = Path(__file__).parents[1]


def start_paused(
    arguments: Sequence[str], moment: str, count: int = 1, *, path: object = ""
) -> subprocess.Popen[str]:
    """legoworld with these arguments, once it has stopped itself.

    moment: "row": `count` rows are in the journal; "asked": Blender, stopped as well, has the
    `count`-th scene of the only worker, and the rows of those before are in the journal; "opens",
    "renames": a file is about to be opened, or renamed to a name, that matches the pattern `path`,
    for the `count`-th time.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "running.paused", moment, str(count), str(path), *arguments],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(_TESTS)},
    )  # fmt: skip
    until(lambda: _state(process.pid), "the pause")
    state = _state(process.pid)
    assert state == signal.SIGSTOP, f"over before its moment came: {process.communicate()}"
    return process


def resume(process: subprocess.Popen[str]) -> None:
    """Let a stopped command go on."""
    os.kill(process.pid, signal.SIGCONT)


def _state(pid: int) -> int | None:
    """The signal that stopped a child; 0 and less where it has ended, None while it runs."""
    flags = os.WSTOPPED | os.WEXITED | os.WNOHANG | os.WNOWAIT
    found = os.waitid(os.P_PID, pid, flags)
    if found is None:
        return None
    return found.si_status if found.si_code == os.CLD_STOPPED else -1


def _main() -> int:
    moment, count, path, *arguments = sys.argv[1:]
    if moment == "row":
        _at_row(int(count))
    elif moment == "asked":
        _at_request(int(count))
    else:
        _at_file({"opens": "open", "renames": "os.rename"}[moment], path, int(count))
    from legoworld import cli

    return cli.run(arguments)


def _stop() -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def _watched_rows(seen: Callable[[int], None]) -> None:
    from legoworld.records.folders import run_journal

    append, rows = run_journal.append, 0

    def then_seen(*arguments: Any) -> Any:
        nonlocal rows
        stored = append(*arguments)
        rows += 1
        seen(rows)
        return stored

    run_journal.append = then_seen


def _at_row(count: int) -> None:
    _watched_rows(lambda rows: _stop() if rows == count else None)


def _at_request(count: int) -> None:
    from legoworld.scene.blender_process import BlenderProcess

    written = threading.Event()
    if count == 1:
        written.set()
    _watched_rows(lambda rows: written.set() if rows == count - 1 else None)
    ask, answer_line, asked = BlenderProcess._ask, BlenderProcess._answer_line, 0

    def stopped_first(self: Any, message: dict[str, Any]) -> Any:
        nonlocal asked
        asked += 1
        if asked == count:
            self.start()
            os.kill(self._process.pid, signal.SIGSTOP)
        return ask(self, message)

    def then_stopped(self: Any, *arguments: Any) -> Any:
        if asked == count:
            written.wait()
            _stop()
        return answer_line(self, *arguments)

    BlenderProcess._ask = stopped_first  # type: ignore[method-assign]
    BlenderProcess._answer_line = then_stopped  # type: ignore[method-assign]


def _at_file(wanted: str, pattern: str, count: int) -> None:
    """By Python's audit events: whatever the command's code is like."""
    seen = 0

    def look(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal seen
        if event != wanted:
            return
        name = arguments[1 if event == "os.rename" else 0]
        if isinstance(name, str | os.PathLike) and Path(os.fspath(name)).match(pattern):
            seen += 1
            if seen == count:
                _stop()

    sys.addaudithook(look)


if __name__ == "__main__":
    sys.exit(_main())
