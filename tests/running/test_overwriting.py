"""--overwrite leaves what the new run makes, and nothing of the one before."""

from __future__ import annotations

from pathlib import Path

import pytest
from running.run_folders import readout, tree
from scene.gltf.documents import Document

from legoworld import cli

FIXED = ("--source", "glb", "--no-cache", "--workers", 1)


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    for number in range(3):
        made = Document()
        made.quad("Card", 0, 0, 8 + number, extras={"category": "cat"})
        folder = tmp_path / "scenes" / f"nested/{number}"
        folder.mkdir(parents=True)
        (folder / "scene.glb").write_bytes(made.glb())
    return tmp_path / "scenes"


@pytest.mark.parametrize("task", ["eth3d", "coco"])
def test_an_overwritten_run_is_as_a_first_one(task, scenes, tmp_path):
    again, first = tmp_path / "again", tmp_path / "first"
    assert readout(scenes, again, *FIXED, task=task) == 0
    for output in (again, first):
        assert readout(scenes, output, *FIXED, "--limit", 1, "--overwrite", task=task) == 0
    assert tree(again) == tree(first)


def test_another_task_leaves_none_of_the_others_results(scenes, tmp_path):
    again, first = tmp_path / "again", tmp_path / "first"
    assert readout(scenes, again, *FIXED, task="eth3d") == 0
    assert readout(scenes, again, *FIXED, "--overwrite", task="coco") == 0
    assert readout(scenes, first, *FIXED, task="coco") == 0
    assert {*tree(again)} == {*tree(first)}


def test_depth_shards_merge_and_are_not_divided(scenes, tmp_path, capsys):
    for shard in ("1/2", "2/2"):
        assert readout(scenes, tmp_path / shard[0], *FIXED, "--shard", shard, task="eth3d") == 0
    shards = [str(tmp_path / "1"), str(tmp_path / "2")]
    capsys.readouterr()
    divided = ["merge", *shards, "-o", str(tmp_path / "divided"), "--images-per-file", "1"]
    assert cli.run(divided) == 2
    assert "only boxes and masks can be divided into files" in capsys.readouterr().err
    assert cli.run(["merge", *shards, "-o", str(tmp_path / "merged")]) == 0
    assert readout(scenes, tmp_path / "whole", *FIXED, task="eth3d") == 0
    assert tree(tmp_path / "merged") == tree(tmp_path / "whole")
