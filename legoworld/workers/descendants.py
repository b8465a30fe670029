"""Finding, measuring and ending all descendants of a process, in any process group."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

_PROC: Final = Path("/proc")
_END_WITHIN_S: Final = 10.0


def descendants(ancestor: int) -> list[int]:
    """The processes below one, nearest first.

    A process whose parent died is adopted by the nearest subreaper above it, so all descendants of
    a subreaper are found, however often they forked. Zombies count as ended.
    """
    children: dict[int, list[int]] = {}
    for pid, parent in _parents():
        children.setdefault(parent, []).append(pid)
    below: list[int] = []
    level = children.get(ancestor, [])
    while level:
        below += level
        level = [child for pid in level for child in children.get(pid, [])]
    return below


def memory_bytes(pids: list[int], enough: int) -> int:
    """The total memory of processes.

    Resident memory counts pages shared by forks once per process: a sum above `enough` is replaced
    by the proportional set size (PSS), which takes the kernel longer.
    """
    resident = sum(resident_bytes(pid) for pid in pids)
    if resident <= enough or len(pids) < 2:
        return resident
    shares = [_proportional_bytes(pid) for pid in pids]
    return sum(
        resident_bytes(pid) if share is None else share
        for pid, share in zip(pids, shares, strict=True)
    )


def resident_bytes(pid: int) -> int:
    """A process's resident memory; 0 when it has ended."""
    try:
        if sys.platform == "linux":
            # Asked 50 times a second while a worker works: with a Path it takes ten times as long.
            descriptor = os.open(f"{_PROC}/{pid}/statm", os.O_RDONLY)
            try:
                pages = int(os.read(descriptor, 200).split()[1])
            finally:
                os.close(descriptor)
            return pages * os.sysconf("SC_PAGE_SIZE")
        return int(_ps("-o", "rss=", "-p", str(pid)) or 0) * 1024
    except (OSError, ValueError, IndexError):
        return 0


def end_all(ancestor: int) -> None:
    """Kill all descendants of a process until none is left.

    They are stopped first, so that none forks while the others are killed. If the ancestor is this
    process, its children are reaped.
    """
    deadline = time.monotonic() + _END_WITHIN_S
    while time.monotonic() < deadline:
        left = [pid for pid in descendants(ancestor) if _runs(pid)]
        for sent in (signal.SIGSTOP, signal.SIGKILL):
            for pid in left:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, sent)
        if ancestor == os.getpid():
            _reap()
        if not left:
            return
        time.sleep(0.002)


def _reap() -> None:
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def _runs(pid: int) -> bool:
    """Whether a process is running, and not a zombie."""
    if sys.platform != "linux":
        state = _ps("-o", "state=", "-p", str(pid)).strip()
        return bool(state) and not state.startswith("Z")
    return _stat(pid)[:1] not in ([], ["Z"], ["X"])


def _parents() -> list[tuple[int, int]]:
    """(process, parent) of every process."""
    if sys.platform != "linux":
        lines = (line.split() for line in _ps("-A", "-o", "pid=,ppid=").splitlines())
        return [(int(pid), int(parent)) for pid, parent in lines]
    try:
        pids = [int(entry.name) for entry in _PROC.iterdir() if entry.name.isdigit()]
    except OSError:
        return []
    return [(pid, int(fields[1])) for pid in pids if len(fields := _stat(pid)) > 1]


def _stat(pid: int) -> list[str]:
    """State and parent of a process, from what follows its name; none when it has ended."""
    try:
        text = (_PROC / str(pid) / "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    return text.rpartition(")")[2].split()[:2]


def _ps(*options: str) -> str:
    return subprocess.run(["ps", *options], capture_output=True, text=True, check=False).stdout


def _proportional_bytes(pid: int) -> int | None:
    try:
        text = (_PROC / str(pid) / "smaps_rollup").read_text()
        return 1024 * next(int(x.split()[1]) for x in text.splitlines() if x.startswith("Pss:"))
    except (OSError, ValueError, StopIteration):
        return None
