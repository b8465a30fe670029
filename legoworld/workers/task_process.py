"""A Python process that applies one function to the items it receives, and its end of the pipe.

Not `multiprocessing`: that re-runs the calling program's main module in every process, and its
processes receive Ctrl-C together with the command, which alone should decide how they end.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any, Final, Generic, TypeVar

from legoworld import exit_codes
from legoworld.errors import LegoWorldError, one_line
from legoworld.workers.child_process import ChildProcess
from legoworld.workers.environment import package_path, python_path
from legoworld.workers.process_privacy import die_with_parent

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Each process is one worker: libraries that start a thread for every core would multiply.
_ONE_THREAD: Final = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)


class ProcessLostError(LegoWorldError):
    """A worker process ended unexpectedly or was killed."""

    code = "process_lost"
    exit_code = exit_codes.BLOCKED


class TaskProcess(Generic[Item, Result]):
    """Calls a function in a process that starts with the first call and is kept for later ones.

    function: importable by its name; the function, its arguments and its results are pickled. The
    process always ends with its owner, because it reads from a pipe that then closes.
    """

    def __init__(self, function: Callable[[Item], Result]) -> None:
        self._function = function
        self._process: ChildProcess | None = None
        self._aborted = False

    def call(self, item: Item) -> Result:
        """The function's result or exception; ProcessLostError when the process ends."""
        process = self._process or self._start()
        if self._aborted:  # seen here or by `abort`, whichever comes second
            process.kill()
        try:
            pickle.dump(item, process.stdin, pickle.HIGHEST_PROTOCOL)
            process.stdin.flush()
            good, value = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            lost = _lost_error(process)
            self.close()
            raise lost from error
        if not good:
            raise value
        result: Result = value
        return result

    def abort(self) -> None:
        """End the process from another thread: its call and all later ones fail."""
        self._aborted = True
        process = self._process  # its own thread may be closing it
        if process is not None:
            process.kill()

    def close(self) -> None:
        """End the process, even during a call."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def _start(self) -> ChildProcess:
        self._process = ChildProcess([sys.executable, "-m", __name__], _environment())
        with suppress(BrokenPipeError):  # it is gone: the call finds out, and how
            pickle.dump(self._function, self._process.stdin, pickle.HIGHEST_PROTOCOL)
        return self._process


def _lost_error(process: ChildProcess) -> ProcessLostError:
    return ProcessLostError(
        "a worker process ended unexpectedly",
        found=one_line(f"{process.how_it_ended()}; {process.last_words()}", 300),
        expected="the results of its items",
        next_step="run the same command again, with fewer --workers where memory is short",
    )


def _environment() -> dict[str, str]:
    """The owner's environment, with its own legoworld first on the path."""
    return {**os.environ, **_ONE_THREAD, "PYTHONPATH": python_path(*package_path())}


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answer (True, result) or (False, exception) until the pipe closes."""
    function = pickle.load(requests)
    while True:
        try:
            item = pickle.load(requests)
        except EOFError:
            return
        answers.write(_answer(function, item))
        answers.flush()


def _answer(function: Callable[[Any], Any], item: Any) -> bytes:
    try:
        return pickle.dumps((True, function(item)), pickle.HIGHEST_PROTOCOL)
    except Exception as error:  # noqa: BLE001  raised where the call was made
        return pickle.dumps((False, make_picklable(error)), pickle.HIGHEST_PROTOCOL)


def make_picklable(error: Exception) -> Exception:
    """The error in a picklable form."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # noqa: BLE001  whatever its class does when it is made again
        return RuntimeError(one_line(f"{type(error).__name__}: {error}"))
    return error


def _main() -> None:
    die_with_parent()  # a killed command leaves no busy process
    # What the function prints is not an answer.
    with suppress(BrokenPipeError), os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)
        _serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    _main()
