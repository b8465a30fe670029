"""The process between legoworld and an untrusted program. Run as a program; see sandbox.py.

It is the subreaper of everything the program starts, so that double forks do not escape, and kills
all of it when the program or legoworld ends for any reason. legoworld sends "end" (b"e") on
standard input or closes it. On standard output the keeper writes one line of JSON when the program
has ended; the program has access to neither.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import select
import signal
import sys
from pathlib import Path
from typing import Final, TypedDict

sys.path.append(str(Path(__file__).parents[2]))

from legoworld.errors import cause
from legoworld.workers.descendants import end_all
from legoworld.workers.removal import remove_folder
from legoworld.workers.task_group import TaskGroup, remove_group

_PR_SET_PDEATHSIG: Final = 1
_PR_SET_CHILD_SUBREAPER: Final = 36
_LINE: Final = 0
_ENDING: Final = 3  # exit_reporter.py's word for it: that file is run, not imported


class Order(TypedDict):
    """What is run.

    input, output, errors: descriptors for the program's own; input null: it has nothing to read.
    group: the folder of the control group that the program joins, or null. witnessed: whether argv
    is bubblewrap with a reporter, which says on a pipe how its program ended.
    """

    argv: list[str]
    cwd: str
    file_bytes: int
    scratch: str
    input: int | None
    output: int
    errors: int
    group: str | None
    witnessed: bool


def main() -> int:
    """Run sys.argv[1], an `Order` as JSON."""
    order: Order = json.loads(sys.argv[1])
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)
    waking, woken = os.pipe()
    os.set_blocking(woken, False)
    signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
    keeper = os.getpid()
    read_ending, write_ending = os.pipe()
    child = os.fork()
    if child == 0:
        _become(order, keeper, write_ending if order["witnessed"] else None)
    for given in {order["input"], order["output"], order["errors"]}:
        if given is not None:
            os.close(given)
    os.close(write_ending)
    code = _wait(child, waking)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)  # without a subreaper, only the group can be ended
    end_all(keeper)
    if order["group"] is not None:
        while _ended_child()[0]:
            pass  # what is ended and not waited for keeps its group
        remove_group(Path(order["group"]))
    if code is not None:
        _say(_reported_code(read_ending, code) if order["witnessed"] else code)
    # The folder is guarded until legoworld has taken what it needs from it.
    if os.read(_LINE, 1) != b"e":  # legoworld was killed
        remove_folder(Path(order["scratch"]))
    return 0


def _wait(child: int, waking: int) -> int | None:
    """The program's exit code, negative for a signal; None if it must be killed first."""
    while True:
        pid, status = _ended_child()
        if pid == child:
            return os.waitstatus_to_exitcode(status)
        if pid:
            continue  # an orphan
        ready, _, _ = select.select([_LINE, waking], [], [])
        if _LINE in ready:
            return None
        os.read(waking, 512)


def _ended_child() -> tuple[int, int]:
    try:
        return os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        return 0, 0


def _reported_code(ending: int, code: int) -> int:
    """The code from the reporter; without it bubblewrap's: it failed, or the reporter died."""
    os.set_blocking(ending, False)
    with contextlib.suppress(OSError, ValueError):
        return max(-255, min(int(os.read(ending, 16)), 255))
    # With nothing said, 128 + n is the signal that ended the reporter.
    return 128 - code if code - 128 in signal.valid_signals() else code


def _become(order: Order, keeper: int, ending: int | None) -> None:
    """Become the program: in a new session, with its limits and only its three descriptors.

    ending: the pipe its reporter gets as well.
    """
    try:
        os.setsid()
        _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != keeper:
            os._exit(127)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        _limit(order["file_bytes"])
        if order["group"] is not None:
            TaskGroup(folder=Path(order["group"])).join_file.write_text("0", encoding="ascii")
        given = order["input"]
        os.dup2(os.open(os.devnull, os.O_RDONLY) if given is None else given, 0)
        os.dup2(order["output"], 1)
        os.dup2(order["errors"], 2)
        if ending is not None:
            os.dup2(ending, _ENDING)
            os.set_inheritable(_ENDING, True)  # also where it was there already
        os.closerange(3 if ending is None else _ENDING + 1, 1 << 16)
        os.chdir(order["cwd"])
        os.execv(order["argv"][0], order["argv"])
    except (OSError, ValueError) as error:
        os.write(2, f"{order['argv'][0]}: {cause(error)}\n".encode())
    finally:
        os._exit(127)


def _limit(file_bytes: int) -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    if hard == resource.RLIM_INFINITY or hard > file_bytes:
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _say(code: int) -> None:
    with contextlib.suppress(OSError):  # legoworld was killed
        os.write(1, json.dumps({"code": code}).encode() + b"\n")


if __name__ == "__main__":
    sys.exit(main())
