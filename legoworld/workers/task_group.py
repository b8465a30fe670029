"""A control group in which the kernel limits the number of a program's processes.

Polling processes from outside is too slow against a fork bomb. If this process may create a group
that counts tasks (cgroup v2, or v1's `pids`), the program is put into one. This is possible as
root, as a user on systemd's own slice, or where a group was delegated.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

#: Tasks are threads; a program may have more of them than processes.
_TASKS_PER_PROCESS: Final = 4
_PROC: Final = Path("/proc/self")
_JOIN: Final = "cgroup.procs"
_LIMIT: Final = "pids.max"
_EMPTY_WITHIN_S: Final = 10.0
_PROBE_WITHIN_S: Final = 20.0
_numbers = itertools.count()


@dataclass(frozen=True, kw_only=True)
class TaskGroup:
    """The control group of one program. folder: below /sys/fs/cgroup."""

    folder: Path

    @property
    def join_file(self) -> Path:
        """A process that writes 0 to this file joins the group, with all its later children."""
        return self.folder / _JOIN


def make_group(processes: int) -> TaskGroup | None:
    """A new group with this process limit; None if this process may not create one."""
    place = group_place()
    return None if place is None else _make_group(place, processes)


@functools.cache
def group_place() -> Path | None:
    """The group below which this process may make others that count tasks, after a trial."""
    import subprocess  # the keeper, which imports this module, starts without it

    for place in _places(_PROC):
        group = _make_group(place, 1)
        if group is None:
            continue
        try:
            program = f"open({str(group.join_file)!r}, 'w').write('0')"
            argv = [sys.executable, "-I", "-S", "-c", program]
            done = subprocess.run(
                argv, check=False, capture_output=True, timeout=_PROBE_WITHIN_S, env={}
            )
            if done.returncode == 0:
                return place
        except (OSError, subprocess.SubprocessError):
            continue
        finally:
            remove_group(group.folder)
    return None


def remove_group(folder: Path) -> None:
    """Remove a group once its last process is gone; otherwise it stays."""
    deadline = time.monotonic() + _EMPTY_WITHIN_S
    while folder.is_dir():
        try:
            folder.rmdir()
        except OSError:
            if time.monotonic() > deadline:
                return
            time.sleep(0.01)


def _make_group(place: Path, processes: int) -> TaskGroup | None:
    folder = place / f"legoworld-{os.getpid()}-{next(_numbers)}"
    try:
        folder.mkdir()
        # Not created where the kernel has none: the group then counts no tasks.
        with (folder / _LIMIT).open("r+") as limit:
            limit.write(str(_TASKS_PER_PROCESS * processes))
    except OSError:
        with contextlib.suppress(OSError):
            folder.rmdir()
        return None
    return TaskGroup(folder=folder)


def _places(proc: Path) -> Iterator[Path]:
    """Groups that may have members that count tasks: this process's own, and those above it."""
    try:
        own = dict(_own_groups((proc / "cgroup").read_text(encoding="utf-8")))
        mounts = (proc / "mountinfo").read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return
    for line in mounts:
        before, _, after = line.partition(" - ")
        kind, _, options = (after.split(" ") + [""] * 3)[:3]
        fields = before.split(" ")
        if kind == "cgroup2":
            controller = ""
        elif kind == "cgroup" and "pids" in options.split(","):
            controller = "pids"
        else:
            continue
        if controller not in own or len(fields) < 5:
            continue
        top = Path(fields[4])
        below = os.path.relpath(own[controller], fields[3])
        inside = not own[controller].startswith("/..") and not below.startswith("..")
        group = top / below if inside else top  # it may lie beside what is mounted here
        yield from (place for place in (group, *group.parents) if place.is_relative_to(top))


def _own_groups(text: str) -> Iterator[tuple[str, str]]:
    """The process's own group by controller: "" is cgroup v2."""
    for line in text.splitlines():
        _, controllers, group = line.split(":", 2)
        yield from ((controller, group) for controller in controllers.split(","))
