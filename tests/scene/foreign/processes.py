"""What a process and the processes it started use, read from /proc (Linux)."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

_POLL_S = 0.05


@dataclass
class Usage:
    """Largest resident memory in bytes of the main process and of any single worker."""

    main_peak: int = 0
    worker_peak: int = 0
    wall_s: float = 0.0
    returncode: int | None = None
    workers: set[int] = field(default_factory=set)


def descendants(pid: int) -> list[int]:
    """Ids of all living processes below `pid`; zombies count as living."""
    found, todo = [], [pid]
    while todo:
        parent = todo.pop()
        for task in _listed(Path(f"/proc/{parent}/task")):
            children = _text(Path(f"/proc/{parent}/task/{task}/children")).split()
            found += [int(child) for child in children]
            todo += [int(child) for child in children]
    return sorted(found)


def resident(pid: int) -> int:
    """Resident bytes now; 0 when the process is gone."""
    fields = _text(Path(f"/proc/{pid}/statm")).split()
    return int(fields[1]) * os.sysconf("SC_PAGE_SIZE") if fields else 0


def peak(pid: int) -> int:
    """The most resident bytes the process has had; 0 when it is gone."""
    for line in _text(Path(f"/proc/{pid}/status")).splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return 0


def open_files(pid: int) -> int:
    """How many file descriptors the process holds."""
    return len(_listed(Path(f"/proc/{pid}/fd")))


def zombies(pid: int) -> int:
    """Ended children that nobody waited for."""
    states = (_text(Path(f"/proc/{child}/stat")).rpartition(")")[2].split() for child in
              descendants(pid))  # fmt: skip
    return sum(bool(state) and state[0] == "Z" for state in states)


def run_measured(
    command: list[str],
    *,
    env: dict[str, str] | None = None,
    stdout: int | None = subprocess.DEVNULL,
    watch: Callable[[int], None] = lambda _pid: None,
) -> Usage:
    """Run a command to its end; `watch` is called with its process id at every sample."""
    usage = Usage()
    began = time.perf_counter()
    process = subprocess.Popen(command, env=env, stdout=stdout)
    while process.poll() is None:
        usage.main_peak = max(usage.main_peak, peak(process.pid))
        for worker in descendants(process.pid):
            usage.workers.add(worker)
            usage.worker_peak = max(usage.worker_peak, peak(worker))
        watch(process.pid)
        time.sleep(_POLL_S)
    usage.wall_s = time.perf_counter() - began
    usage.returncode = process.returncode
    return usage


def _listed(folder: Path) -> list[str]:
    try:
        return [entry.name for entry in folder.iterdir()]
    except OSError:
        return []


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""
