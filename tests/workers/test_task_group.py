"""The kernel counts a program's tasks where it may, and nothing of the group stays."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import pytest
from waiting import until

from legoworld.workers import task_group
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import Ending, Sandbox, SandboxLimits
from legoworld.workers.task_group import group_place, make_group, remove_group

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="control groups are Linux's")

THREADS = """
    import threading
    wait = threading.Event()
    started = 0
    try:
        for _ in range(200):
            threading.Thread(target=wait.wait, daemon=True).start()
            started += 1
    except RuntimeError as error:
        print(error)
    print(started, flush=True)
    import os; os._exit(0)
"""


@pytest.fixture
def place() -> Path:
    found = group_place()
    if found is None:
        pytest.skip("this process may make no control group that counts tasks")
    return found


def groups_of(place: Path, pid: int) -> list[Path]:
    return sorted(place.glob(f"legoworld-{pid}-*"))


def run(confinement: str, scratch: Path, program: str, *, counted: bool) -> Ending:
    scratch.mkdir()
    held = replace(protections(confinement), task_group=counted)  # pyright: ignore[reportArgumentType]
    limits = SandboxLimits(time_s=300.0, memory_bytes=1 << 30, processes=20)
    with Sandbox(scratch, limits, held, owner=scratch) as sandbox:
        sandbox.start([sys.executable, "-c", textwrap.dedent(program)], [])
        return sandbox.wait()


def test_the_kernel_starts_no_more_than_the_limit(confinement, place, tmp_path):
    ending = run(confinement, tmp_path / "counted", THREADS, counted=True)
    refusal, started = ending.last_output.splitlines()
    assert refusal == "can't start new thread"
    assert 60 < int(started) < 80  # four tasks a process, of which some are the sandbox's own
    assert groups_of(place, os.getpid()) == []
    free = run(confinement, tmp_path / "free", THREADS, counted=False)
    assert free.last_output == "200\n"


def test_what_holds_says_whether_the_kernel_counts():
    held = protections("limits")
    assert ("process count in the kernel" in held.holds) == (group_place() is not None)
    assert "process count in the kernel" not in held.does_not_hold


def test_killed_with_legoworld_no_group_is_left(confinement, place, tmp_path):
    scratch = tmp_path / "scratch"
    owner = f"""
import pathlib, sys
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import Sandbox, SandboxLimits
scratch = pathlib.Path({str(scratch)!r})
scratch.mkdir()
sandbox = Sandbox(scratch, SandboxLimits(time_s=600.0, memory_bytes=1 << 30),
                  protections({confinement!r}), owner=scratch)
sandbox.start([sys.executable, "-c", "import time; time.sleep(600)"], [])
sandbox.wait()
"""
    with subprocess.Popen([sys.executable, "-c", owner]) as process:
        own = place / f"legoworld-{process.pid}-1"  # after the trial's
        until(lambda: own.is_dir() and (own / "cgroup.procs").read_text())
        process.kill()
    until(lambda: not groups_of(place, process.pid) and not scratch.exists())


def test_a_group_with_a_process_in_it_stays(place, monkeypatch):
    group = make_group(5)
    assert group is not None
    assert (group.folder / "pids.max").read_text() == "20\n"
    program = f"open({str(group.join_file)!r}, 'w').write('0'); print(flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        with monkeypatch.context() as patch:
            patch.setattr(task_group, "_EMPTY_WITHIN_S", 0.05)
            remove_group(group.folder)
        assert group.folder.is_dir()
        process.communicate(b"\n")
    remove_group(group.folder)
    assert not group.folder.exists()


@pytest.mark.parametrize(
    ("groups", "mount", "places"),
    [
        (  # a terminal of a desktop: systemd gave the user all below user@1000.service
            "0::/user.slice/user-1000.slice/user@1000.service/app.slice/term.scope",
            "/ /fs rw - cgroup2 cgroup2 rw",
            ["user.slice/user-1000.slice/user@1000.service/app.slice/term.scope",
             "user.slice/user-1000.slice/user@1000.service/app.slice",
             "user.slice/user-1000.slice/user@1000.service",
             "user.slice/user-1000.slice", "user.slice", ""],
        ),
        ("0::/", "/ /fs rw - cgroup2 cgroup2 rw", [""]),  # a container with a namespace of its own
        ("0::/docker/12/a", "/docker/12 /fs rw shared:4 - cgroup2 cgroup2 rw", ["a", ""]),
        ("0::/../other", "/ /fs rw - cgroup2 cgroup2 rw", [""]),  # outside of what is mounted
        ("3:cpu,pids:/job/7\n0::/", "/ /fs rw - cgroup cgroup rw,cpu,pids", ["job/7", "job", ""]),
        ("3:cpu:/job/7\n0::/", "/ /fs rw - cgroup cgroup rw,cpu", []),
        ("damaged", "/ /fs rw - cgroup2 cgroup2 rw", []),
    ],
)  # fmt: skip
def test_groups_are_looked_for_from_the_own_one_upwards(groups, mount, places, tmp_path):
    (tmp_path / "cgroup").write_text(groups + "\n")
    (tmp_path / "mountinfo").write_text(
        f"31 23 0:28 / /proc rw - proc proc rw\n41 31 0:38 {mount}\n"
    )
    assert [*task_group._places(tmp_path)] == [Path("/fs") / name for name in places]


def test_where_no_group_can_be_made_there_is_none(tmp_path, monkeypatch):
    (tmp_path / "cgroup").write_text("0::/\n")
    (tmp_path / "mountinfo").write_text(f"41 31 0:38 / {tmp_path} rw - cgroup2 cgroup2 rw\n")
    monkeypatch.setattr(task_group, "_PROC", tmp_path)
    group_place.cache_clear()
    try:
        assert group_place() is None  # a folder without pids.max counts nothing
        assert make_group(5) is None
        assert not [path for path in tmp_path.iterdir() if path.is_dir()]
    finally:
        group_place.cache_clear()
