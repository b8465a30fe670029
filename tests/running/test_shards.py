"""A run divided into shards and merged is the undivided run, byte for byte."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from running.run_folders import readout as readout_of
from running.run_folders import results
from scene.gltf.documents import Document

from legoworld import cli
from legoworld.errors import UsageError
from legoworld.running.merge_shards import _refuse_losses


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    for name in ("no_camera", *(f"scene{i}" for i in range(5))):
        made = Document(camera=name != "no_camera")
        made.quad("Dog", int(name[-1]) if name[-1].isdigit() else 0, 0, extras={"category": "dog"})
        (folder / name).mkdir()
        (folder / name / "scene.glb").write_bytes(made.glb())
    return folder


def readout(scenes: object, run: object, *more: object, task: str = "coco") -> int:
    fixed = ("--source", "glb", "--no-cache", "--workers", 1)
    return readout_of(scenes, run, *fixed, *more, task=task)


def merge(output: Path, *shards: Path) -> int:
    return cli.run(["merge", *map(str, shards), "-o", str(output)])


TASKS = ["coco", "lvis", "eth3d", "normals", "relations", "coco-panoptic"]


@pytest.mark.parametrize("task", TASKS)
def test_merged_shards_are_the_undivided_run(task, scenes: Path, tmp_path: Path):
    assert readout(scenes, tmp_path / "whole", task=task) == 1  # one scene has no camera
    shards = [tmp_path / f"shard{i}" for i in (1, 2, 3, 4)]
    for i, shard in enumerate(shards, 1):
        readout(scenes, shard, "--shard", f"{i}/4", task=task)
    assert merge(tmp_path / "merged", *shards[::-1]) == 1
    assert results(tmp_path / "merged") == results(tmp_path / "whole")


def test_what_is_merged_are_runs_however_many(scenes: Path, tmp_path: Path, capsys):
    for i in (1, 2):
        readout(scenes, tmp_path / f"shard{i}", "--shard", f"{i}/2")
    capsys.readouterr()
    merge(tmp_path / "two", tmp_path / "shard1", tmp_path / "shard2")
    merge(tmp_path / "one", tmp_path / "two")
    two, one = capsys.readouterr().out.splitlines()
    assert (two.split(",")[0], one.split(",")[0]) == ("2 runs", "1 run")


def test_more_shards_than_images(scenes: Path, tmp_path: Path):
    readout(scenes, tmp_path / "whole")
    shards = [tmp_path / f"shard{i}" for i in range(1, 9)]
    for i, shard in enumerate(shards, 1):
        readout(scenes, shard, "--shard", f"{i}/8")
    merge(tmp_path / "merged", *shards)
    assert results(tmp_path / "merged") == results(tmp_path / "whole")


def test_a_limited_run_may_be_divided_and_stays_partial(scenes: Path, tmp_path: Path):
    readout(scenes, tmp_path / "whole", "--limit", 3)
    shards = [tmp_path / "a", tmp_path / "b"]
    for i, shard in enumerate(shards, 1):
        readout(scenes, shard, "--limit", 3, "--shard", f"{i}/2")
    merge(tmp_path / "merged", *shards)
    assert results(tmp_path / "merged") == results(tmp_path / "whole")
    assert json.loads((tmp_path / "merged" / "summary.json").read_text())["partial"]


def test_a_shard_says_that_it_is_partial(scenes: Path, tmp_path: Path):
    readout(scenes, tmp_path / "shard", "--shard", "2/2")
    summary = json.loads((tmp_path / "shard" / "summary.json").read_text())
    assert summary["partial"]
    assert summary["coverage"]["attempted"] == 3


def test_a_run_done_again_for_nothing_keeps_every_byte(scenes: Path, tmp_path: Path):
    readout(scenes, tmp_path / "run")
    document = json.loads((tmp_path / "run" / "run.json").read_text())
    document["finished_at"] = "2020-01-01T00:00:00Z"
    text = json.dumps(document, sort_keys=True, ensure_ascii=False, indent=1) + "\n"
    (tmp_path / "run" / "run.json").write_text(text)
    readout(scenes, tmp_path / "run")
    assert (tmp_path / "run" / "run.json").read_text() == text


def test_merging_again_after_a_shard_was_read_again(scenes: Path, tmp_path: Path):
    shards = [tmp_path / "a", tmp_path / "b"]
    for i, shard in enumerate(shards, 1):
        readout(scenes, shard, "--shard", f"{i}/2")
    merge(tmp_path / "merged", *shards)
    before = results(tmp_path / "merged")
    merge(tmp_path / "merged", *shards)
    assert results(tmp_path / "merged") == before


@pytest.mark.parametrize("value", ["0/2", "3/2", "1/0", "1", "a/b", "1/2/3", "-1/2"])
def test_a_shard_that_is_none_is_refused(value, scenes: Path, tmp_path: Path):
    assert readout(scenes, tmp_path / "run", "--shard", value) == 2
    assert not (tmp_path / "run").exists()


def test_shards_that_make_up_no_run_are_refused(scenes: Path, tmp_path: Path, capsys):
    a, b, other, whole = (tmp_path / name for name in ("a", "b", "other", "whole"))
    readout(scenes, a, "--shard", "1/2")
    readout(scenes, b, "--shard", "2/2")
    readout(scenes, other, "--shard", "2/2", "--limit", 2)
    readout(scenes, whole)
    for shards, said in [
        ([a], "missing: 2/2"),
        ([a, a, b], "given twice: 1/2"),
        ([a, other], "different images_sha256"),
        ([a, whole], "not a shard"),
        ([tmp_path, b], f"{tmp_path} is not a run: it holds {a}, which is a run"),
        ([whole, a], "whole is not a shard"),
        ([a, a, b, b], "given twice: 1/2, 2/2"),
    ]:
        capsys.readouterr()
        assert merge(tmp_path / "merged", *shards) in (1, 2)
        assert said in capsys.readouterr().err
        assert not (tmp_path / "merged" / "run.json").exists()


def test_a_merge_into_one_of_its_inputs_is_refused(scenes: Path, tmp_path: Path, capsys):
    shards = [tmp_path / "a", tmp_path / "b"]
    for i, shard in enumerate(shards, 1):
        readout(scenes, shard, "--shard", f"{i}/2")
    before = results(shards[1])
    capsys.readouterr()
    for more in ((), ("--overwrite",)):
        assert cli.run(["merge", *map(str, shards), "-o", str(shards[1]), *more]) == 2
        assert "-o b is one of the input runs" in capsys.readouterr().err
    assert results(shards[1]) == before


def test_a_shard_that_has_not_ended_or_lost_predictions_is_refused(
    scenes: Path, tmp_path: Path, capsys
):
    shards = [tmp_path / "a", tmp_path / "b"]
    for i, shard in enumerate(shards, 1):
        readout(scenes, shard, "--shard", f"{i}/2")
    (shards[0] / "journal.jsonl").write_text("")
    assert merge(tmp_path / "merged", *shards) == 2
    said = capsys.readouterr().err
    assert "a is not a finished shard; found: it has not ended" in said
    (shards[0] / "journal.jsonl").unlink()
    document = json.loads((shards[0] / "run.json").read_text())
    document["configuration"]["task"] = "cocoa"
    (shards[0] / "run.json").write_text(json.dumps(document))
    assert merge(tmp_path / "merged", *shards) == 2
    assert "found: task 'cocoa'" in capsys.readouterr().err


def test_one_undivided_run_is_rewritten_in_files(scenes: Path, tmp_path: Path):
    readout(scenes, tmp_path / "whole")
    readout(scenes, tmp_path / "divided", "--images-per-file", 2)
    code = cli.run(["merge", str(tmp_path / "whole"), "-o", str(tmp_path / "made"),
                    "--images-per-file", "2"])  # fmt: skip
    assert code == 1
    assert results(tmp_path / "made") == results(tmp_path / "divided")
    assert cli.run(["merge", str(tmp_path / "made"), "-o", str(tmp_path / "back")]) == 1
    assert results(tmp_path / "back") == results(tmp_path / "whole")


@pytest.mark.parametrize(("rows", "found"), [(2, 3), (3, 2)])
def test_predictions_that_are_fewer_or_more_than_the_row_says_are_refused(rows, found):
    row = SimpleNamespace(n_predictions=rows, image_id=7)
    record = SimpleNamespace(predictions=[None] * found, row=row)
    with pytest.raises(UsageError, match=f"{found} of image 7"):
        _refuse_losses(Path("shard"), record)
    _refuse_losses(Path("shard"), SimpleNamespace(predictions=[None] * rows, row=row))


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_shards_of_different_numbers_are_refused_in_any_order(order, scenes, tmp_path, capsys):
    shards = [tmp_path / "a", tmp_path / "b"]
    for shard, part in zip(shards, ("1/2", "3/3"), strict=True):
        readout(scenes, shard, "--shard", part)
    capsys.readouterr()
    assert merge(tmp_path / "merged", *(shards[i] for i in order)) == 2
    assert "different numbers of shards" in capsys.readouterr().err
