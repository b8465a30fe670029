"""The main process's side of Blender: a worker process with a time and a memory limit."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from legoworld.errors import (
    LegoWorldError,
    Raised,
    WorkerCrashedError,
    WorkerMemoryError,
    WorkerTimeoutError,
    from_reason,
    one_line,
)
from legoworld.scene.requests import Request
from legoworld.workers.child_process import ChildProcess
from legoworld.workers.descendants import resident_bytes
from legoworld.workers.environment import blender_environment
from legoworld.workers.scratch import ScratchFolder

_POLL_S: Final = 0.02
#: A worker that has read this many files is replaced: Blender's memory grows slowly with each.
_RECYCLE_AFTER: Final = 200
_RECYCLE_SHARE: Final = 0.5  # of the memory limit
#: A worker's answer when the disk it writes to is full or read-only.
DISK: Final = "disk"


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one request may use."""

    time_s: float = 120.0
    memory_bytes: int = 8 << 30


class BlenderProcess:
    """Runs requests in a Blender process that is started when needed and replaced when spent."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._process: ChildProcess | None = None
        self._home: ScratchFolder | None = None
        self._workspaces: dict[tuple[str, Path | None], ScratchFolder] = {}
        self._n_requests = 0
        self._aborted = self._interrupted = False
        #: Held to start and to abort: an abort comes before a process is made, or finds it.
        self._owning = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()

    def start(self) -> None:
        """Start the process now; the first request then finds bpy imported."""
        self._start_worker()

    def request(self, message: Request) -> dict[str, Any]:
        """The worker's answer.

        Raises the error the worker reports, or WorkerCrashedError, WorkerTimeoutError or
        WorkerMemoryError. A process that has served other files before and fails is replaced and
        asked once more, so that no scene is judged by what came before it; so is one that was
        killed from outside.
        """
        if self._aborted:
            raise self._crash_error()
        self._interrupted = False
        self._recycle()
        used = self._n_requests > 0
        try:
            return self._ask(message)
        except (WorkerCrashedError, WorkerTimeoutError, WorkerMemoryError) as error:
            if self._aborted or self._interrupted:
                raise
            killed = isinstance(error, WorkerCrashedError) and self._was_killed()
            self._drop()
            if not used and not killed:
                raise
        try:
            return self._ask(message)
        except LegoWorldError:
            if self._has_ended():
                self._drop()
            raise

    def abort(self) -> None:
        """End the process from another thread: its request fails, and so does every later one."""
        with self._owning:
            self._aborted = True
            if self._process is not None:
                self._process.kill()

    def interrupt(self) -> None:
        """End the running request from another thread: it fails, and the next one starts anew."""
        with self._owning:
            self._interrupted = True
            if self._process is not None:
                self._process.kill()

    def workspace(self, prefix: str, parent: Path | None = None) -> Path:
        """A scratch folder that requests may write to, made when first asked for.

        It outlives the process that is running and goes with `close`.
        """
        place = (prefix, parent)
        if place not in self._workspaces:
            self._workspaces[place] = ScratchFolder(prefix, parent)
        return self._workspaces[place].path.resolve()

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._drop()
        while self._workspaces:
            self._workspaces.popitem()[1].close()

    def _start_worker(self) -> ChildProcess:
        if self._process is not None:
            return self._process
        self._home = ScratchFolder("legoworld-blender-")
        home = self._home.path
        empty, environment = _make_folder(home, "empty"), _environment(home)
        with self._owning:
            if self._aborted:
                raise self._crash_error()
            self._process = ChildProcess(
                [sys.executable, "-m", "legoworld.scene.blender.worker"],
                environment,
                cwd=empty,
                kept=(self._home.owner_fd,),
            )
        self._n_requests = 0
        return self._process

    def _drop(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None
        if self._home is not None:
            self._home.close()
            self._home = None

    def _ask(self, message: Request) -> dict[str, Any]:
        process = self._start_worker()
        deadline = time.monotonic() + self._limits.time_s
        try:
            process.send(json.dumps(message).encode() + b"\n")
        except BrokenPipeError as error:
            raise self._crash_error() from error
        try:
            line = self._answer_line(process, deadline)
        except LegoWorldError:
            process.end()  # it cannot be used any more; its log is kept for the message
            raise
        self._n_requests += 1
        answer: dict[str, Any] = json.loads(line)
        if answer.pop("ok"):
            return answer
        if answer["reason"]["code"] == WorkerMemoryError.code:
            raise self._out_of_memory()
        if answer["reason"]["code"] == DISK:
            # No verdict on the scene: every other one would meet it, too.
            number = answer["reason"]["errno"]
            output = Path(message.get("output", "."))
            place = next((p for p in output.parents if not p.name.startswith(".")), output)
            raise OSError(number, os.strerror(number), str(place))
        reported = from_reason(answer["reason"])
        reported.trace = answer.get("trace", "")
        raise reported

    def _answer_line(self, process: ChildProcess, deadline: float) -> bytes:
        while not process.answers(_POLL_S):
            if resident_bytes(process.pid) > self._limits.memory_bytes:
                raise self._out_of_memory()
            if time.monotonic() > deadline:
                raise WorkerTimeoutError(
                    "Blender did not finish with the scene",
                    found=f"no answer after {self._limits.time_s:g} s",
                    expected="an answer within the time limit",
                    next_step="simplify the scene, or raise --time-limit",
                )
        line = process.stdout.readline()
        if not line.endswith(b"\n"):
            raise self._crash_error()
        return line

    def _crash_error(self) -> WorkerCrashedError:
        how, words = "aborted", "no message"
        if self._process is not None:
            how, words = self._process.how_it_ended(), self._process.last_words(_is_of_blender)
        advice = (
            "the file may be damaged: open it in Blender and save it again"
            if how.startswith("signal")
            else "a library Blender needs may be missing: `legoworld doctor` checks"
        )
        return WorkerCrashedError(
            "Blender ended while it had the scene",
            found=one_line(f"{how}; {words}", 300),
            expected="a snapshot of the scene",
            next_step=advice,
        )

    def _out_of_memory(self) -> WorkerMemoryError:
        gib = self._limits.memory_bytes / 2**30
        return WorkerMemoryError(
            "Blender outgrew its memory limit with the scene",
            found=f"more than {gib:g} GiB",
            expected=f"at most {gib:g} GiB",
            next_step="lower the scene's subdivision levels, or raise --memory-limit",
        )

    def _has_ended(self) -> bool:
        return self._process is not None and self._process.exit_code() is not None

    def _was_killed(self) -> bool:
        """Whether it ended by a SIGKILL: of the system, out of memory, or from outside."""
        return self._process is not None and self._process.exit_code() == -signal.SIGKILL

    def _recycle(self) -> None:
        if self._process is None:
            return
        grown = resident_bytes(self._process.pid) > _RECYCLE_SHARE * self._limits.memory_bytes
        if self._n_requests >= _RECYCLE_AFTER or grown or self._has_ended():
            self._drop()


def _is_of_blender(line: str) -> bool:
    """Whether a line of the log begins with no clock and names no place."""
    return bool(line.strip()) and not line[0].isdigit() and "/" not in line


def _make_folder(folder: Path, name: str) -> Path:
    path = folder / name
    path.mkdir()
    return path


def _environment(home: Path) -> dict[str, str]:
    """The worker's environment: no user preferences, no start-up files, this legoworld.

    Blender makes a folder for temporary files and one for thumbnails, and a killed Blender leaves
    them: they lie where they are removed with the process.
    """
    return blender_environment(
        home=_make_folder(home, "blender"), temporary=_make_folder(home, "temporary")
    )
