"""Stopped before any change of a file, by Ctrl-C or for good: the same command then ends well.

"For good" is a kill: from that moment on nothing on the disk changes, clean-up included.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from baselines.tracks import make_track
from evaluation.detection_runs import random_predictions, random_truth, write_run, write_truth
from running.run_folders import tree

from legoworld import cli

pytestmark = pytest.mark.blender

SCENES = """
for i in range(3):
    fresh(); camera()
    quad("Dog", x=i - 1, category="dog")
    save(f"scene{i}")
"""


class Killed(BaseException):
    """The end of a process that does nothing more."""


@contextmanager
def stopped_before(number: int, *, killed: bool) -> Iterator[list[bool]]:
    """Stop the program before its `number`-th change of a file; tells whether it came so far."""
    reached: list[bool] = []
    steps = count(1)

    def step() -> None:
        if reached and killed:
            raise Killed
        if next(steps) == number:
            reached.append(True)
            raise Killed if killed else KeyboardInterrupt

    def before(original: Callable[..., Any]) -> Callable[..., Any]:
        def stepping(*arguments: Any, **named: Any) -> Any:
            step()
            return original(*arguments, **named)

        return stepping

    with pytest.MonkeyPatch.context() as patch:
        for owner, names in (
            (Path, ("mkdir", "replace", "rename", "unlink", "rmdir")),
            (os, ("fsync", "link")),
            (shutil, ("copyfile", "rmtree")),
        ):
            for name in names:
                patch.setattr(owner, name, before(getattr(owner, name)))
        yield reached


@dataclass(frozen=True, kw_only=True)
class World:
    """What the commands read; nothing in it is changed."""

    scenes: Path
    cache: Path
    track: Path
    depths: Path
    results: Path
    run: Path
    truth: Path
    shards: tuple[Path, ...]
    box_shards: tuple[Path, ...]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory, build_scenes) -> World:
    folder = tmp_path_factory.mktemp("world")
    scenes, cache = folder / "scenes", folder / "cache"
    build_scenes(SCENES, scenes)
    names = [f"scene{i}.jpg" for i in range(3)]
    for i in range(3):
        (folder / "depths").mkdir(exist_ok=True)
        np.save(folder / "depths" / f"scene{i}.npy", np.full((48, 64), i + 1, np.float32))
    truth = random_truth("coco", seed=1, images=2, categories=1)
    made = World(
        scenes=scenes,
        cache=cache,
        track=make_track(folder / "track.json", names),
        depths=folder / "depths",
        results=folder / "results.json",
        run=write_run(folder / "run", "coco", truth, random_predictions("coco", truth, seed=2)),
        truth=write_truth(folder / "truth.json", truth),
        shards=(folder / "shard1", folder / "shard2"),
        box_shards=(folder / "box_shard1", folder / "box_shard2"),
    )
    for i, shard in enumerate(made.shards, 1):
        assert cli.run([*readout("eth3d")(made, shard), "--shard", f"{i}/2"]) == 0
    for i, shard in enumerate(made.box_shards, 1):
        assert cli.run([*readout("coco")(made, shard), "--shard", f"{i}/2"]) == 0
    made.results.write_text(
        json.dumps([{"image_id": 1, "category_id": 18, "bbox": [1, 2, 3, 4], "score": 0.5}])
    )
    return made


Command = Callable[[World, Path], list[str]]


def readout(task: str, *more: str) -> Command:
    return lambda world, output: [
        "readout", "-q", str(world.scenes), "--task", task, "-o", str(output),
        "--cache", str(world.cache), "--workers", "1", *more,
    ]  # fmt: skip


def freeze(world: World, output: Path) -> list[str]:
    if not output.exists():
        shutil.copytree(world.scenes, output)
    return ["freeze", "-q", str(output), "--cache", str(world.cache), "--workers", "1"]


def merge(world: World, output: Path) -> list[str]:
    return ["merge", *map(str, world.shards), "-o", str(output)]


def merge_into_files(world: World, output: Path) -> list[str]:
    return ["merge", *map(str, world.box_shards), "-o", str(output), "--images-per-file", "2"]


def bring(task: str) -> Command:
    more = ["--space", "depth", "--unit", "m"] if task == "eth3d" else []
    return lambda world, output: [
        "baseline", "import", "-q", str(world.depths if more else world.results), "--task", task,
        "--track", str(world.track), "-o", str(output), *more,
    ]  # fmt: skip


def evaluate(world: World, output: Path) -> list[str]:
    return [
        "evaluate", "-q", str(world.run), "--truth", str(world.truth), "-o", str(output),
        "--draws", "3",
    ]  # fmt: skip


COMMANDS: dict[str, Command] = {
    "readout coco": readout("coco"),
    "readout coco, in files": readout("coco", "--images-per-file", "2"),
    "readout eth3d": readout("eth3d"),
    "freeze": freeze,
    "merge": merge,
    "merge, into files": merge_into_files,
    "import coco": bring("coco"),
    "import eth3d": bring("eth3d"),
    "evaluate": evaluate,
}


def stop(arguments: list[str], number: int, *, killed: bool, capfd: Any) -> bool:
    """Run a command that is stopped before its n-th change; False when it has fewer."""
    capfd.readouterr()
    with stopped_before(number, killed=killed) as reached:
        try:
            code = cli.run(arguments)
        except Killed:
            code = -9
    error = capfd.readouterr().err
    if not reached:
        assert code == 0
        return False
    assert code == (-9 if killed else 130)
    if not killed:
        assert error.strip().count("\n") == 0, error
        assert "run the same command again" in error
    return True


@pytest.mark.parametrize("killed", [False, True], ids=["ctrl-c", "killed"])
@pytest.mark.parametrize("name", COMMANDS)
def test_the_same_command_again_ends_as_if_never_stopped(name, killed, world, tmp_path, capfd):
    command = COMMANDS[name]
    undisturbed = tmp_path / "undisturbed"
    assert cli.run(command(world, undisturbed)) == 0
    expected, number = tree(undisturbed), 0
    for number in count(1):
        output = tmp_path / f"before{number}"
        arguments = command(world, output)
        if not stop(arguments, number, killed=killed, capfd=capfd):
            break
        assert cli.run(arguments) == 0, number
        assert tree(output) == expected, number
    assert number > 4


#: The readout that is stopped while it replaces an earlier one, and the earlier one's options.
OVERWRITES: dict[str, tuple[list[str], list[str]]] = {
    "coco": (["coco"], ["--limit", "2"]),
    "eth3d": (["eth3d"], ["--limit", "2"]),
    "files by one file": (["coco"], ["--images-per-file", "1"]),
    "one file by files": (["coco", "--images-per-file", "1"], []),
    "files by fewer": (["coco", "--images-per-file", "2"], ["--images-per-file", "1"]),
}


@pytest.mark.parametrize("killed", [False, True], ids=["ctrl-c", "killed"])
@pytest.mark.parametrize("name", OVERWRITES)
def test_a_stopped_overwrite_mixes_nothing(name, killed, world, tmp_path, capfd):
    undisturbed, earlier = tmp_path / "undisturbed", tmp_path / "earlier"
    now, before = OVERWRITES[name]
    again, anew = readout(*now), readout(*now, "--overwrite")
    assert cli.run(again(world, undisturbed)) == 0
    assert cli.run(readout(now[0], *before)(world, earlier)) == 0
    expected, number = tree(undisturbed), 0
    for number in count(1):
        output = tmp_path / f"before{number}"
        shutil.copytree(earlier, output)
        if not stop(anew(world, output), number, killed=killed, capfd=capfd):
            break
        if cli.run(again(world, output)) == 2:
            assert "a run of another configuration" in capfd.readouterr().err
            assert cli.run(anew(world, output)) == 0, number
        assert tree(output) == expected, number
    assert number > 4


@pytest.mark.parametrize("killed", [False, True], ids=["ctrl-c", "killed"])
@pytest.mark.parametrize("division", [[], ["--images-per-file", "1"]], ids=["one file", "files"])
def test_a_stopped_second_run_mixes_nothing(division, killed, world, tmp_path, capfd):
    """Of a scene that changed since the first run, which had ended, as it stands in its folder."""
    undisturbed, earlier = tmp_path / "undisturbed", tmp_path / "earlier"
    command = readout("coco", *division)
    assert cli.run(command(world, earlier)) == 0
    scenes = tmp_path / "scenes"
    shutil.copytree(world.scenes, scenes)
    labels = {"version": 1, "labels": [{"object": "Dog", "category": "cat"}]}
    (scenes / "scene1" / "labels.json").write_text(json.dumps(labels))
    changed = replace(world, scenes=scenes)
    assert cli.run(command(changed, undisturbed)) == 0
    expected, number = tree(undisturbed), 0
    assert expected != tree(earlier)
    for number in count(1):
        output = tmp_path / f"before{number}"
        shutil.copytree(earlier, output)
        arguments = command(changed, output)
        if not stop(arguments, number, killed=killed, capfd=capfd):
            break
        assert cli.run(arguments) == 0, number
        assert tree(output) == expected, number
    assert number > 4
