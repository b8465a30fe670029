"""A Python process that applies one function to the items it receives, and its end of the pipe.

Not `multiprocessing`: that re-runs the calling program's main module in every process, and its
processes receive Ctrl-C together with the command, which alone should decide how they end.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final, Generic, TypeVar

from legoworld import exit_codes
from legoworld.errors import LegoWorldError, one_line

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
        self._process: subprocess.Popen[bytes] | None = None
        self._stderr: IO[bytes] | None = None
        self._aborted = False

    def call(self, item: Item) -> Result:
        """The function's result or exception; ProcessLostError when the process ends."""
        process = self._process or self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        if self._aborted:  # seen here or by `abort`, whichever comes second
            process.kill()
        try:
            pickle.dump(item, process.stdin, pickle.HIGHEST_PROTOCOL)
            process.stdin.flush()
            good, value = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            lost = self._lost()
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
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    with suppress(BrokenPipeError):  # a killed reader leaves unsent bytes behind
                        pipe.close()
            self._process = None
        if self._stderr is not None:
            self._stderr.close()
            self._stderr = None

    def _started(self) -> subprocess.Popen[bytes]:
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115  closed with the process
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            start_new_session=True,  # Ctrl-C is for the command: it decides what becomes of this
            env=_environment(),
        )
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # it is gone: the call finds out, and how
            pickle.dump(self._function, self._process.stdin, pickle.HIGHEST_PROTOCOL)
        return self._process

    def _lost(self) -> ProcessLostError:
        assert self._process is not None
        assert self._stderr is not None
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5)
        code = self._process.returncode
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        self._stderr.seek(max(0, self._stderr.seek(0, os.SEEK_END) - 4000))
        words = self._stderr.read().decode("utf-8", "replace").strip().splitlines()
        return ProcessLostError(
            "a worker process ended unexpectedly",
            found=one_line(f"{how}; {words[-1] if words else 'no message'}", 300),
            expected="the results of its items",
            next_step="run the same command again, with fewer --workers where memory is short",
        )


def _environment() -> dict[str, str]:
    """The owner's environment, with its own legoworld first on the path."""
    root = str(Path(__file__).parents[2])
    path = os.pathsep.join([root, *(p for p in (os.environ.get("PYTHONPATH"),) if p)])
    return {**os.environ, **_ONE_THREAD, "PYTHONPATH": path}


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
        return pickle.dumps((False, carried(error)), pickle.HIGHEST_PROTOCOL)


def carried(error: Exception) -> Exception:
    """The error in a picklable form."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # noqa: BLE001  whatever its class does when it is made again
        return RuntimeError(one_line(f"{type(error).__name__}: {error}"))
    return error


def _die_with_owner() -> None:
    """Ensure that a killed command leaves no busy process; an idle one ends by itself."""
    if sys.platform == "linux":
        import ctypes

        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


def _main() -> None:
    _die_with_owner()
    # What the function prints is not an answer.
    with suppress(BrokenPipeError), os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)
        _serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    _main()
