"""A run outlives kills, full and read-only disks, a second run and Ctrl-C: nothing is lost or torn.

Disks of a few kilobytes are mounted in a mount namespace of the test's own (`unshare`); where that
is not allowed those tests are skipped.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from baselines.tracks import make_track
from evaluation.detection_runs import random_predictions, random_truth, write_run, write_truth
from running import paused
from running.run_folders import tree
from scene.foreign.processes import descendants
from waiting import PATIENCE_S, until

pytestmark = pytest.mark.blender

N_SCENES = 8
SCENES = f"""
for i in range({N_SCENES}):
    fresh(); camera()
    quad("Dog", x=i - 3, category="dog"); quad("Wall", z=-2, half=9)
    save(f"scene{{i}}")
"""
PROGRAM = [sys.executable, "-m", "legoworld"]
KILLED = -signal.SIGKILL


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory, build_scenes) -> Path:
    folder = tmp_path_factory.mktemp("survival")
    build_scenes(SCENES, folder / "scenes")
    return folder / "scenes"


@pytest.fixture(scope="module")
def undisturbed(scenes: Path) -> dict[str, dict[str, bytes]]:
    """What each task's run holds when nothing goes wrong."""
    found = {}
    for task in ("coco", "lvis", "eth3d"):
        output = scenes.parent / f"undisturbed {task}"
        done = finish(readout(scenes, output, task, "--cache", str(scenes.parent / "cache")))
        assert done.returncode == 0, done.stderr
        found[task] = tree(output)
    return found


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files of the commands of this test."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    return folder


def readout(scenes: Path, output: Path, task: str, *more: str) -> list[str]:
    return [
        *PROGRAM, "readout", str(scenes), "--task", task, "-o", str(output), "-q",
        "--workers", "1", *more,
    ]  # fmt: skip


def finish(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)


def start(command: Sequence[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def stop(
    command: Sequence[str], moment: str, count: int = 1, *, path: object = ""
) -> subprocess.Popen[str]:
    """A command of PROGRAM that has stopped itself; see running/paused.py."""
    assert list(command[: len(PROGRAM)]) == PROGRAM
    return paused.start_paused(command[len(PROGRAM) :], moment, count, path=path)


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.is_file() else 0


# Kills.


@pytest.mark.parametrize("scene", [1, 3], ids=["its first", "a later one"])
def test_a_worker_killed_mid_scene_is_replaced_and_its_scene_read_again(
    scene, scenes, undisturbed, tmp_path, temporary
):
    output = tmp_path / "run"
    process = stop(readout(scenes, output, "coco", "--no-cache"), "asked", scene)
    worker, *_ = descendants(process.pid)  # what its imports may have started comes after it
    os.kill(worker, signal.SIGKILL)
    paused.resume(process)
    _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, error
    assert tree(output) == undisturbed["coco"]
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("task", ["coco", "lvis", "eth3d"])
def test_a_killed_run_goes_on_and_the_next_one_sweeps_what_it_left(
    task, scenes, undisturbed, tmp_path, temporary
):
    output, cache = tmp_path / "run", tmp_path / "cache"
    command = readout(scenes, output, task, "--cache", str(cache))
    process = stop(command, "asked", 3)
    assert any(cache.glob(".reading-*"))
    workers = descendants(process.pid)
    process.kill()
    process.communicate()
    assert lines(output / "journal.jsonl") == 2
    assert any(temporary.glob("legoworld-blender-*"))
    assert workers
    until(lambda: not any(map(is_running, workers)), "the end of the command's worker")
    assert finish(command).returncode == 0
    assert tree(output) == undisturbed[task]
    assert list(temporary.iterdir()) == []
    assert not any(cache.glob(".reading-*"))


def test_a_folder_that_a_living_command_owns_is_not_swept(scenes, tmp_path, temporary):
    process = stop(readout(scenes, tmp_path / "long", "coco", "--no-cache"), "row")
    owned = set(temporary.glob("legoworld-blender-*"))
    assert owned
    other = finish(readout(scenes, tmp_path / "other", "coco", "--no-cache", "--limit", "1"))
    assert owned <= set(temporary.glob("legoworld-blender-*"))
    paused.resume(process)
    process.communicate(timeout=PATIENCE_S)
    assert (other.returncode, process.returncode) == (0, 0)
    assert list(temporary.iterdir()) == []


# Disks.


@pytest.fixture
def mounted(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a shell script (arguments $1, $2, ...) that may mount; its mounts end with it."""
    allowed = shutil.which("unshare") and finish(
        ["unshare", "-rm", "mount", "-t", "tmpfs", "tmpfs", str(tmp_path)]
    )
    if not allowed or allowed.returncode:
        pytest.skip("no mount namespaces here: `unshare -rm mount -t tmpfs` is refused")

    def run(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
        return finish(["unshare", "-rm", "sh", "-c", script, "sh", *map(str, arguments)])

    return run


#: $1: the small disk, $2: where it is copied to, $3: its size; the rest: the command.
FULL = """
disk=$1 copy=$2 size=$3; shift 3
mount -t tmpfs -o size=$size tmpfs "$disk" || exit 99
"$@"; first=$?
echo "exit codes $first" >&2
cp -r "$disk" "$copy.full" || exit 99
mount -o remount,size=50m "$disk" || exit 99
"$@"; second=$?
cp -r "$disk" "$copy" || exit 99
[ $first = 4 ] && [ $second = 0 ]
"""


def said(done: subprocess.CompletedProcess[str]) -> list[str]:
    return [line for line in done.stderr.splitlines() if line.startswith("legoworld: ")]


@pytest.mark.parametrize(("task", "size"), [("coco", "12k"), ("lvis", "12k"), ("eth3d", "60k")])
def test_a_full_output_disk_stops_the_run_and_room_lets_it_go_on(
    task, size, scenes, undisturbed, tmp_path, mounted
):
    disk, copy = tmp_path / "disk", tmp_path / "copy"
    disk.mkdir()
    cache = str(scenes.parent / "cache")
    done = mounted(FULL, disk, copy, size, *readout(scenes, disk, task, "--cache", cache))
    assert done.returncode == 0, done.stderr
    (line,) = said(done)
    assert "No space left on device" in line
    assert str(disk) in line
    assert not list((tmp_path / "copy.full").rglob(".*.tmp"))
    assert 0 < lines(tmp_path / "copy.full" / "journal.jsonl") < N_SCENES
    assert tree(copy) == undisturbed[task]


def test_a_full_cache_disk_is_no_verdict_on_the_scenes(scenes, undisturbed, tmp_path, mounted):
    disk, output = tmp_path / "disk", tmp_path / "run"
    disk.mkdir()
    command = readout(scenes, output, "coco", "--cache", str(disk))
    done = mounted(FULL, disk, tmp_path / "copy", "40k", *command)
    assert done.returncode == 0, done.stderr
    (line,) = said(done)
    assert "No space left on device" in line
    assert str(disk) in line
    assert not list((tmp_path / "copy.full").glob(".reading-*"))
    assert tree(output) == undisturbed["coco"]


def test_a_full_disk_under_an_evaluation(tmp_path, mounted, evaluation):
    disk, copy, whole = tmp_path / "disk", tmp_path / "copy", tmp_path / "whole"
    disk.mkdir()
    assert finish(evaluation(whole)).returncode == 0
    done = mounted(FULL, disk, copy, "40k", *evaluation(disk))
    assert done.returncode == 0, done.stderr
    assert "No space left on device" in said(done)[0]
    assert not (tmp_path / "copy.full" / "evidence.json").exists()
    assert tree(copy) == tree(whole)


@pytest.mark.parametrize("what", ["readout", "cache", "freeze", "merge", "evaluate"])
def test_a_read_only_folder_is_one_clear_line(what, scenes, tmp_path, mounted, evaluation):
    disk = tmp_path / "disk"
    shutil.copytree(scenes, disk)
    before = tree(disk)
    shards = []
    if what == "merge":
        shards = [tmp_path / "shard"]
        assert finish(readout(scenes, shards[0], "coco", "--shard", "1/1")).returncode == 0
    command = {
        "readout": readout(scenes, disk / "new", "coco", "--no-cache"),
        "cache": readout(scenes, tmp_path / "run", "coco", "--cache", str(disk / "new")),
        "freeze": [*PROGRAM, "freeze", str(disk), "--no-cache", "--workers", "1"],
        "merge": [*PROGRAM, "merge", *map(str, shards), "-o", str(disk / "new")],
        "evaluate": evaluation(disk / "new"),
    }[what]
    script = 'disk=$1; shift; mount --bind "$disk" "$disk" && mount -o remount,bind,ro "$disk" '
    done = mounted(script + '|| exit 99; "$@"', disk, *command)
    assert done.returncode == 4, done.stderr
    (line,) = done.stderr.splitlines()
    refused = "the snapshot cache cannot be written" if what == "cache" else "the operating system"
    assert line.startswith(f"legoworld: {refused}")
    assert str(disk) in line
    assert "Read-only file system" in line
    assert tree(disk) == before


# Two at once.


def test_a_second_run_into_the_folder_is_refused_and_the_first_ends_whole(
    scenes, undisturbed, tmp_path
):
    output = tmp_path / "run"
    command = readout(scenes, output, "coco", "--no-cache")
    first = stop(command, "row")
    for more in ([], ["--overwrite"]):
        second = finish([*command, *more])
        assert second.returncode == 2
        (line,) = second.stderr.splitlines()
        assert "another process is writing into the run folder" in line
    paused.resume(first)
    first.communicate(timeout=PATIENCE_S)
    assert first.returncode == 0
    assert tree(output) == undisturbed["coco"]


def test_two_evaluations_into_one_folder_leave_a_whole_one(tmp_path, evaluation):
    output = tmp_path / "eval"
    processes = [start(evaluation(output, "--seed", str(seed))) for seed in (1, 2)]
    codes = sorted(p.wait(timeout=PATIENCE_S) for p in processes)
    for process in processes:
        process.communicate()
    # Who writes second finds another evaluation there, and is refused.
    assert codes == [0, 2]
    assert finish([*PROGRAM, "evidence", "verify", str(output)]).returncode == 0


# Ctrl-C.


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., list[str]]:
    """The command that evaluates a run of 60 images into a folder."""
    folder = tmp_path_factory.mktemp("evaluation")
    truth = random_truth("coco", seed=1, images=60)
    run = write_run(folder / "run", "coco", truth, random_predictions("coco", truth, seed=2))
    path = write_truth(folder / "truth.json", truth)
    return lambda output, *more: [
        *PROGRAM, "evaluate", str(run), "--truth", str(path), "-o", str(output), "--draws", "300",
        *more,
    ]  # fmt: skip


#: What Ctrl-C says of the commands that keep what is done, and of the others.
FREEZES = "records written so far are kept; run the same command again to freeze the rest"
BEGINS = "nothing was kept; run the same command again to start over"


def interrupt_command(process: subprocess.Popen[str], left: str = BEGINS) -> None:
    """Ctrl-C to a command that is stopped: exit code 130, one line, and no process left."""
    os.kill(process.pid, signal.SIGINT)
    paused.resume(process)
    _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, error
    assert error.strip() == f"legoworld: stopped; {left}"
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


def ends_like(command: Sequence[str], output: Path, whole: Path) -> None:
    """What is there is not torn, and the same command ends as if never stopped."""
    for path in output.rglob("*.json"):
        json.loads(path.read_text())
    done = finish(command)
    assert done.returncode in (0, 1), done.stderr
    assert tree(output) == tree(whole)


def test_ctrl_c_during_freeze(scenes, tmp_path):
    torn, whole = tmp_path / "torn", tmp_path / "whole"
    for folder in (torn, whole):
        shutil.copytree(scenes, folder)
    freeze = [*PROGRAM, "freeze", "-q", "--no-cache", "--workers", "1"]
    assert finish([*freeze, str(whole)]).returncode == 0
    again = [*freeze, str(torn)]
    interrupt_command(stop(again, "renames", 3, path=torn / "*" / "frozen.json"), FREEZES)
    assert 0 < len(list(torn.glob("*/frozen.json"))) < N_SCENES
    ends_like(again, torn, whole)


def test_ctrl_c_during_evaluate(tmp_path, evaluation):
    torn, whole = tmp_path / "torn", tmp_path / "whole"
    assert finish(evaluation(whole)).returncode == 0
    # Its files are written when the run and the truth have been read.
    interrupt_command(stop(evaluation(torn, "-q"), "renames", path=torn / "*"))
    assert not (torn / "evidence.json").exists()
    ends_like(evaluation(torn), torn, whole)


def test_ctrl_c_during_merge(scenes, tmp_path):
    """Shards of many images that have no scene: rows without Blender."""
    track = make_track(tmp_path / "track.json", [f"absent{i}.jpg" for i in range(6)])
    shards = [tmp_path / "shard1", tmp_path / "shard2"]
    for i, shard in enumerate(shards, 1):
        more = ["--track", str(track), "--shard", f"{i}/2"]
        assert finish(readout(scenes, shard, "coco", *more)).returncode == 1
    merge = [*PROGRAM, "merge", *map(str, shards), "-o"]
    torn, whole = tmp_path / "torn", tmp_path / "whole"
    assert finish([*merge, str(whole)]).returncode == 1
    interrupt_command(stop([*merge, str(torn)], "row"))
    ends_like([*merge, str(torn)], torn, whole)


def test_ctrl_c_during_an_import(tmp_path):
    (tmp_path / "depths").mkdir()
    for i in range(4):
        np.save(tmp_path / "depths" / f"photo{i}.npy", np.full((48, 64), 1 + i, np.float32))
    track = make_track(tmp_path / "track.json", [f"photo{i}.jpg" for i in range(4)])
    bring = [
        *PROGRAM, "baseline", "import", "-q", str(tmp_path / "depths"), "--task", "eth3d",
        "--track", str(track), "--space", "depth", "--unit", "m", "-o",
    ]  # fmt: skip
    torn, whole = tmp_path / "torn", tmp_path / "whole"
    assert finish([*bring, str(whole)]).returncode == 0
    interrupt_command(stop([*bring, str(torn)], "row", 2))
    ends_like([*bring, str(torn)], torn, whole)
