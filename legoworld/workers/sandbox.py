"""The sandbox of untrusted programs: isolated by bubblewrap where it works, limited everywhere.

A keeper (keeper.py) starts the program and kills all of its descendants. docs/sandbox.md lists the
protections with and without bubblewrap.
"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final, Literal, Self

from legoworld.errors import Raised
from legoworld.workers.bubblewrap import (
    INSIDE,
    TEMPORARY_INSIDE,
    Bubblewrap,
    confine,
    find_bubblewrap,
)
from legoworld.workers.child_process import ChildProcess
from legoworld.workers.descendants import descendants, end_all, memory_bytes
from legoworld.workers.environment import blender_environment
from legoworld.workers.process_privacy import hide_process
from legoworld.workers.protections import Protections
from legoworld.workers.task_group import make_group, remove_group

Limit = Literal["time", "memory", "disk", "output", "processes"]

_KEEPER: Final = Path(__file__).with_name("keeper.py")
_FOLDERS: Final = ("empty", "home", "temporary", "shared", "output")
_KEPT_BYTES: Final = 64 << 10  # of each end of what is printed
_LOOK_EVERY_S: Final = 0.05
_LOOK_AT_LEAST_EVERY_S: Final = 0.5
_LOOK_AT_DISK_EVERY_S: Final = 0.5
_MOST_FILES: Final = 100_000
_END: Final = b"e"  # keeper.py's word for it: that file is run, not imported
_END_WITHIN_S: Final = 15.0


@dataclass(frozen=True, kw_only=True)
class SandboxLimits:
    """Limits of a program together with everything it starts.

    disk_bytes: of its workspace, and of any single file; output_bytes: what it may print.
    """

    time_s: float
    memory_bytes: int
    disk_bytes: int = 4 << 30
    output_bytes: int = 64 << 20
    processes: int = 512


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How a program ended.

    code: its exit code, below 0 the signal that ended it; None when `over` names the limit it was
    ended for. first_output, last_output: the two ends of what it printed.
    """

    code: int | None
    over: Limit | None
    first_output: str
    last_output: str


class Sandbox:
    """A program in a sandbox, from its start to the end of everything it started.

    scratch: an empty folder for its files. The program starts in `scratch/empty`, and its results
    are looked for in `scratch/output`. owner: the folder that the keeper removes should legoworld
    be killed. workspace: a folder that stays, which the program can write to as well and starts in;
    it counts towards the disk limit. variables: of its environment, besides the usual ones. The
    time limit begins here. lease: a descriptor whose lock the keeper holds, too, so that it is free
    when everything has ended, even where legoworld was killed.
    """

    def __init__(
        self,
        scratch: Path,
        limits: SandboxLimits,
        protections: Protections,
        *,
        owner: Path,
        workspace: Path | None = None,
        variables: Mapping[str, str] | None = None,
        lease: int | None = None,
    ) -> None:
        self.scratch = scratch.resolve()
        self._owner = owner.resolve()
        self._lease = lease
        self._limits = limits
        self._confined = protections.bubblewrap is not None
        self._network = protections.network
        self._group = make_group(limits.processes) if protections.task_group else None
        self._workspace = None if workspace is None else workspace.resolve()
        self._variables = dict(variables or {})
        #: When the time limit is reached, in time.monotonic() seconds, in every process.
        self.deadline = time.monotonic() + limits.time_s
        self._keeper: ChildProcess | None = None
        self._output_pipe: IO[bytes] | None = None
        self._head, self._tail = b"", b""
        self._printed_bytes = 0
        for name in _FOLDERS:
            (scratch / name).mkdir()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()

    def path_inside(self, name: str) -> Path:
        """A file or folder of the scratch folder as the program sees it."""
        return (INSIDE if self._confined else self.scratch) / name

    def add_variables(self, variables: Mapping[str, str]) -> None:
        """Variables of the program's environment that name files as it sees them."""
        self._variables |= variables

    def start(self, argv: Sequence[str], read_only: Sequence[Path]) -> None:
        """Start a program. read_only: files it can read besides Python, Blender and libraries."""
        read_output, write_output = os.pipe()
        self._output_pipe = open(read_output, "rb", buffering=0)  # noqa: SIM115, PTH123
        ends = (None, write_output, write_output)
        self._begin(argv, self._environment(), ends, read_only=read_only)

    def _begin(
        self,
        argv: Sequence[str],
        environment: Mapping[str, str],
        ends: tuple[int | None, int, int],
        **shown: Any,
    ) -> None:
        """Start the keeper. ends: the program's ends of its pipes; shown: as in `confine`."""
        command = list(argv)
        if self._confined:
            bubblewrap = find_bubblewrap()
            assert isinstance(bubblewrap, Bubblewrap)
            command = confine(
                bubblewrap,
                argv,
                scratch=self.scratch,
                workspace=self._workspace,
                network=self._network,
                **shown,
            )
        else:
            hide_process()
        order = {
            "argv": command,
            "cwd": str(self._workspace or self.scratch / "empty"),
            "file_bytes": self._limits.disk_bytes,
            **dict(zip(("input", "output", "errors"), ends, strict=True)),
            "witnessed": self._confined,
            "scratch": str(self._owner),
            "group": str(self._group.folder) if self._group else None,
        }
        given = {end for end in ends if end is not None}
        try:
            self._keeper = ChildProcess(
                [sys.executable, "-I", "-S", str(_KEEPER), json.dumps(order)],
                environment,
                kept=(*given, *(() if self._lease is None else (self._lease,))),
            )
        finally:
            for end in given:
                os.close(end)

    def wait(self) -> Ending:
        """Wait until the program ends or exceeds a limit; afterwards none of its processes runs."""
        keeper = self._keeper
        assert keeper is not None
        assert self._output_pipe is not None
        look, look_at_disk = 0.0, 0.0
        with selectors.DefaultSelector() as selector:
            selector.register(keeper.stdout, selectors.EVENT_READ)
            selector.register(self._output_pipe, selectors.EVENT_READ)
            while True:
                ready = {key.fileobj for key, _ in selector.select(_LOOK_EVERY_S)}
                if self._output_pipe in ready and not self._read_output():
                    selector.unregister(self._output_pipe)
                if self._printed_bytes > self._limits.output_bytes:
                    return self._end_for("output")
                if keeper.stdout in ready:
                    return self._end_from_line(keeper.stdout.readline())
                now, used = time.monotonic(), time.thread_time()
                over = (
                    self._exceeded_limit(keeper.pid, now, disk=now > look_at_disk)
                    if now > look
                    else None
                )
                if now > look_at_disk:
                    look_at_disk = time.monotonic() + _LOOK_AT_DISK_EVERY_S
                if now > look:
                    # Looking at many processes takes time: at most a twentieth of it, counted in
                    # CPU time, so that a fork bomb that starves this thread is not looked at later.
                    pause = max(_LOOK_EVERY_S, 20 * (time.thread_time() - used))
                    look = time.monotonic() + min(pause, _LOOK_AT_LEAST_EVERY_S)
                if over is not None:
                    return self._end_for(over)

    def stop(self) -> None:
        """End the program from a thread other than the one in `wait`, which then returns."""
        keeper = self._keeper
        if keeper is not None:
            with contextlib.suppress(OSError, ValueError):  # it is being closed already
                keeper.send(_END)

    def close(self) -> None:
        """End the program and everything it started. The scratch folder stays for its owner."""
        keeper, self._keeper = self._keeper, None
        if keeper is not None:
            with contextlib.suppress(BrokenPipeError):
                keeper.send(_END)
            if keeper.exit_code(within_s=_END_WITHIN_S) is None:  # a program has stopped it
                end_all(keeper.pid)
            keeper.close()
        if self._group is not None:  # its keeper has, unless it was killed
            remove_group(self._group.folder)
            self._group = None
        if self._output_pipe is not None:
            self._output_pipe.close()
            self._output_pipe = None

    @property
    def temporary(self) -> Path:
        """The folder for temporary files as the program sees it."""
        return TEMPORARY_INSIDE if self._confined else self.path_inside("temporary")

    def _environment(self) -> dict[str, str]:
        home = self.path_inside("home")
        return blender_environment(home=home, temporary=self.temporary) | self._variables

    def _read_output(self) -> bool:
        """Read the printed output and keep its end; False at the end of the stream."""
        assert self._output_pipe is not None
        data = self._output_pipe.read(1 << 16)
        self._printed_bytes += len(data)
        self._head += data[: _KEPT_BYTES - len(self._head)]
        self._tail = (self._tail + data)[-_KEPT_BYTES:]
        return bool(data)

    def _exceeded_limit(self, keeper: int, now: float, *, disk: bool) -> Limit | None:
        """The limit that is exceeded, if any."""
        pids = descendants(keeper)
        if len(pids) > self._limits.processes:
            return "processes"
        if memory_bytes(pids, self._limits.memory_bytes) > self._limits.memory_bytes:
            return "memory"
        if disk and self._disk_bytes() > self._limits.disk_bytes:
            return "disk"
        return "time" if now > self.deadline else None

    def _disk_bytes(self) -> int:
        kept = workspace_bytes(self._workspace) if self._workspace else 0
        return workspace_bytes(self.scratch) + kept

    def _end_for(self, over: Limit) -> Ending:
        self._read_what_is_left()
        self.close()
        return self._make_ending(None, over)

    def _end_from_line(self, line: bytes) -> Ending:
        self._read_what_is_left()
        if not line:
            self.close()
        return self._make_ending(parse_exit_code(line), None)

    def _make_ending(self, code: int | None, over: Limit | None) -> Ending:
        return Ending(
            code=code,
            over=over,
            first_output=self._head.decode("utf-8", "replace"),
            last_output=self._tail.decode("utf-8", "replace"),
        )

    def _read_what_is_left(self) -> None:
        """Read the rest of the pipe."""
        assert self._output_pipe is not None
        os.set_blocking(self._output_pipe.fileno(), False)
        with contextlib.suppress(BlockingIOError, TypeError):
            while self._printed_bytes <= self._limits.output_bytes and self._read_output():
                pass


def parse_exit_code(line: bytes) -> int:
    """The exit code a keeper reports; no report means that the keeper was killed."""
    return int(json.loads(line)["code"]) if line else -signal.SIGKILL


def workspace_bytes(folder: Path) -> int:
    """Disk usage of the files below a folder; infinite if there are too many to count."""
    total, files = 0, 0
    pending = [folder]
    while pending:
        folder = pending.pop()
        try:
            # Not followed where the program has exchanged it for a link since.
            listed = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        except (FileNotFoundError, NotADirectoryError):
            continue  # gone since
        except OSError:
            return 1 << 62  # closed to us, or nested beyond any path: not to be counted
        try:
            with os.scandir(listed) as entries:
                for entry in entries:
                    files += 1
                    if files > _MOST_FILES:
                        return 1 << 62
                    try:
                        if entry.is_dir(follow_symlinks=False):
                            pending.append(folder / entry.name)
                        else:
                            total += entry.stat(follow_symlinks=False).st_blocks * 512
                    except FileNotFoundError:
                        continue
        except OSError:
            return 1 << 62
        finally:
            os.close(listed)
    return total
