"""A child process: its start, its pipes, its end with everything it started, its last words.

Under Blender's workers, the processes of baselines, tasks and the Draco decoder, and the keepers of
sandboxes. What is sent, and what an answer means, is up to each of these.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import subprocess
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Final

_REAP_EVERY_S: Final = 0.002
_LOG_BYTES: Final = 4000


class ChildProcess:
    """A process in a session of its own: Ctrl-C goes to the command, which decides how it ends.

    environment: all of its variables. kept: descriptors that it inherits. Its standard error is
    kept for `last_words`; with `error_pipe` it is the pipe `stderr` instead, for the caller to
    read. `kill` may be called from any thread, everything else from one. One that is dropped
    without `close` ends as well. OSError when it cannot be started.
    """

    def __init__(
        self,
        argv: Sequence[str],
        environment: Mapping[str, str],
        *,
        cwd: Path | None = None,
        kept: Sequence[int] = (),
        error_pipe: bool = False,
    ) -> None:
        #: Held to kill and to reap: a number that was reaped may be another process's.
        self._owning = threading.Lock()
        self._log: IO[bytes] | None = None
        if not error_pipe:
            self._log = tempfile.TemporaryFile()  # noqa: SIM115  closed with the process
        try:
            self._process = subprocess.Popen(
                argv,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log or subprocess.PIPE,
                start_new_session=True,
                cwd=cwd,
                env=environment,
                pass_fds=kept,
            )
        except BaseException:
            self._close_log()
            raise
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self.stdin, self.stdout = self._process.stdin, self._process.stdout
        self.stderr = self._process.stderr
        self.pid = self._process.pid
        weakref.finalize(self, _end_dropped, self._process, self._log, os.getpid()).atexit = False
        self._answers = select.poll()
        self._answers.register(self.stdout, select.POLLIN)

    def send(self, data: bytes) -> None:
        """Write to its standard input. BrokenPipeError when it has closed it."""
        self.stdin.write(data)
        self.stdin.flush()

    def answers(self, within_s: float) -> bool:
        """Whether its standard output can be read, or ends, within the time."""
        return bool(self._answers.poll(within_s * 1000))

    def output_for(self, data: bytes, time_s: float) -> bytes:
        """Its complete output for a complete input; TimeoutError after the time limit."""
        try:
            return self._process.communicate(data, time_s)[0]
        except subprocess.TimeoutExpired as error:
            raise TimeoutError from error

    def exit_code(self, *, within_s: float = 0.0) -> int | None:
        """The exit code, negative for a signal, once it has ended; None where it runs."""
        deadline = time.monotonic() + within_s
        while (code := self._reap()) is None and time.monotonic() < deadline:
            time.sleep(_REAP_EVERY_S)
        return code

    def kill(self) -> None:
        """Kill it and its process group, unless it has ended."""
        with self._owning:
            if self._process.returncode is None:
                self._kill_group()

    def end(self) -> None:
        """Kill it and wait for it to end. Its pipes and buffered output stay readable."""
        self.kill()
        self.exit_code(within_s=math.inf)

    def close(self) -> None:
        """End it and close the pipes."""
        self.end()
        for pipe in (self.stdin, self.stdout, self.stderr):
            if pipe is not None:
                # A killed reader leaves unsent bytes behind.
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
        self._close_log()

    def how_it_ended(self, *, within_s: float = 5.0) -> str:
        """The signal or the exit code; "exit code None" where it does not end within the time."""
        code = self.exit_code(within_s=within_s)
        return f"exit code {code}" if code is None or code >= 0 else f"signal {-code}"

    def last_words(self, meant: Callable[[str], bool] = bool) -> str:
        """The last non-empty line on standard error that `meant` accepts."""
        assert self._log is not None
        self._log.seek(max(0, self._log.seek(0, os.SEEK_END) - _LOG_BYTES))
        lines = self._log.read().decode("utf-8", "replace").splitlines()
        return last_line(line for line in lines if meant(line))

    def _reap(self) -> int | None:
        with self._owning:
            runs = self._process.returncode is None
            code = self._process.poll()
            if runs and code is not None:
                # What it started in its group. The group keeps the number while it has a member.
                self._kill_group()
            return code

    def _kill_group(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def _close_log(self) -> None:
        if self._log is not None:
            self._log.close()


def _end_dropped(process: subprocess.Popen[bytes], log: IO[bytes] | None, owner_pid: int) -> None:
    """End a process whose `ChildProcess` is gone; a fork's copy is not its owner."""
    if os.getpid() == owner_pid and process.returncode is None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    for file in (process.stdin, process.stdout, process.stderr, log):
        if file is not None:
            with contextlib.suppress(BrokenPipeError):
                file.close()


def last_line(lines: Iterable[str]) -> str:
    """The last line that is not empty, for a message about a process that ended."""
    return next((line.strip() for line in reversed([*lines]) if line.strip()), "no message")
