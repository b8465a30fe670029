"""Folders of several tasks, from tracks to a page: each task as it is alone."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from running.run_folders import results

import legoworld
from legoworld import cli
from legoworld.errors import LegoWorldError, UsageError
from legoworld.shipped import catalog

DATA = catalog.folder("datasets") / "skimage_examples"
TRUTHS = {"coco": DATA / "truth_coco.json", "lvis": DATA / "truth_lvis.json"}
NAMED = [word for task, path in TRUTHS.items() for word in ("--truth", f"{task}={path}")]
TASKS = [word for task in TRUTHS for word in ("--task", task)]


def run(*words: object, code: int = 0) -> None:
    assert cli.run([str(word) for word in words]) == code


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """tracks, runs, evals and comparisons of both tasks, and everything of COCO alone."""
    top = tmp_path_factory.mktemp("tasks")
    pairs = [w for task, path in TRUTHS.items() for w in ("--task", task, "--truth", path)]
    run("track", "make", *pairs, "-o", top / "tracks")
    scenes = catalog.folder("examples")
    run("readout", scenes, *TASKS, "--track", top / "tracks", "-o", top / "runs", "-q")
    (top / "truths").mkdir()
    for task, path in TRUTHS.items():
        (top / "truths" / f"{task}.json").symlink_to(path)
    run("evaluate", top / "runs", "--truth", top / "truths", "-o", top / "evals", "--draws", 20)
    run("compare", top / "evals", top / "evals", "-o", top / "comparisons", "--draws", 20)
    return top


@pytest.mark.blender
def test_tracks_are_over_the_same_photos_and_equal_those_made_alone(folder, tmp_path):
    for task, truth in TRUTHS.items():
        alone = tmp_path / f"{task}.json"
        run("track", "make", "--task", task, "--truth", truth, "-o", alone)
        assert alone.read_bytes() == (folder / "tracks" / f"{task}.json").read_bytes()


def truth_of_two(tmp_path: Path) -> Path:
    """LVIS truth of two of the four photos, under other ids."""
    document = json.loads(TRUTHS["lvis"].read_text())
    document["images"] = [dict(i, id=i["id"] + 70) for i in document["images"][1:3]]
    ids = {image["id"] for image in document["images"]}
    document["annotations"] = [
        dict(a, image_id=a["image_id"] + 70)
        for a in document["annotations"]
        if a["image_id"] + 70 in ids
    ]
    path = tmp_path / "two.json"
    path.write_text(json.dumps(document))
    return path


def images(path: Path) -> list[str]:
    return [image["file_name"] for image in json.loads(path.read_text())["images"]]


def test_photos_of_all_truths_or_of_any(tmp_path):
    pair = ["--task", "coco", "--truth", TRUTHS["coco"], "--task", "lvis"]
    pair += ["--truth", truth_of_two(tmp_path)]
    run("track", "make", *pair, "-o", tmp_path / "all")
    assert images(tmp_path / "all/coco.json") == images(tmp_path / "all/lvis.json")
    assert len(images(tmp_path / "all/coco.json")) == 2
    run("track", "make", *pair, "--any", "-o", tmp_path / "any")
    assert (len(images(tmp_path / "any/coco.json")), len(images(tmp_path / "any/lvis.json"))) == (
        4,
        2,
    )
    run("track", "make", *pair, "--sample", 1, "--seed", 3, "-o", tmp_path / "one")
    assert images(tmp_path / "one/coco.json") == images(tmp_path / "one/lvis.json")
    assert json.loads((tmp_path / "one/lvis.json").read_text())["info"]["sample"] == 1
    name = images(tmp_path / "all/coco.json")[1]
    (tmp_path / "list").write_text(f"{name}\n")
    run("track", "make", *pair, "--images", tmp_path / "list", "-o", tmp_path / "chosen")
    assert images(tmp_path / "chosen/lvis.json") == images(tmp_path / "chosen/coco.json") == [name]


def test_what_tracks_of_several_tasks_cannot_be(tmp_path, capsys):
    pair = ["--task", "coco", "--truth", TRUTHS["coco"], "--task", "lvis"]
    run("track", "make", *pair, "-o", tmp_path / "a", code=2)
    assert "one --truth for each --task" in capsys.readouterr().err
    run("track", "make", *pair[:4], "--any", "-o", tmp_path / "a", code=2)
    assert "--any is for several --task" in capsys.readouterr().err
    document = json.loads(TRUTHS["lvis"].read_text())
    for image in document["images"]:
        image["file_name"] = f"other/{image['file_name']}"
    (tmp_path / "other.json").write_text(json.dumps(document))
    run("track", "make", *pair, "--truth", tmp_path / "other.json", "-o", tmp_path / "a", code=2)
    assert "no photo in common" in capsys.readouterr().err
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "lvis.json").write_text("mine")
    run("track", "make", *pair, "--truth", TRUTHS["lvis"], "-o", tmp_path / "b", code=2)
    assert not (tmp_path / "b" / "coco.json").exists()
    assert not (tmp_path / "a").exists()


@pytest.mark.blender
def test_each_evaluation_and_comparison_has_the_bytes_of_its_task_alone(folder, tmp_path):
    """Paths in evidence are relative to a folder, so the copy lies as the folder does."""
    shutil.copytree(folder / "runs", tmp_path / "runs")
    for task, truth in TRUTHS.items():
        where = tmp_path / "evals" / task
        run("evaluate", tmp_path / "runs" / task, "--truth", truth, "-o", where, "--draws", 20)
        for name in ("summary.json", "per_image.jsonl", "per_category.jsonl", "matches.npz"):
            assert (where / name).read_bytes() == (folder / "evals" / task / name).read_bytes()
        both = (folder / "evals" / task, folder / "evals" / task)
        run("compare", *both, "-o", tmp_path / task, "--draws", 20)
        one = (tmp_path / task / "comparison.json").read_bytes()
        assert one == (folder / "comparisons" / task / "comparison.json").read_bytes()


@pytest.mark.blender
def test_the_api_takes_mappings_and_gives_results_by_task(folder, tmp_path):
    found = legoworld.evaluate(folder / "runs", tmp_path / "evals", truth=TRUTHS, draws=20)
    assert isinstance(found, legoworld.ByTask)
    assert list(found) == list(TRUTHS)
    assert found["coco"].metrics["AP"] == pytest.approx(0.9557, abs=1e-4)
    assert {row["task"] for row in found.table} == set(TRUTHS)
    assert set(found.to_dict()["tasks"]) == set(TRUTHS)
    assert found._repr_html_().count("<h4>") == 2
    compared = legoworld.compare([found, found], tmp_path / "comparisons", draws=20)
    assert list(compared) == list(TRUTHS)
    some = legoworld.evaluate(
        folder / "runs", tmp_path / "some", truth={"lvis": TRUTHS["lvis"]}, draws=20
    )
    assert list(some) == ["lvis"]
    only = legoworld.compare([found, some], tmp_path / "only", draws=20)
    assert list(only) == ["lvis"]


@pytest.mark.blender
def test_one_task_that_cannot_be_scored_does_not_keep_the_others(folder, tmp_path):
    said: list[str] = []
    with pytest.raises(LegoWorldError, match="different categories"):
        legoworld.evaluate(
            folder / "runs", tmp_path, truth={"coco": TRUTHS["lvis"], "lvis": TRUTHS["lvis"]},
            draws=20, listener=legoworld.Listener(warn=said.append),
        )  # fmt: skip
    assert (tmp_path / "lvis" / "summary.json").is_file()
    assert said == [f"evaluated: lvis -> {tmp_path}"]


@pytest.mark.blender
def test_what_evaluating_several_tasks_cannot_be(folder, tmp_path, capsys):
    runs = folder / "runs"
    run("evaluate", runs, "--truth", TRUTHS["coco"], "-o", tmp_path / "e", code=2)
    assert "holds the runs of coco, lvis: pass --truth TASK=PATH" in capsys.readouterr().err
    run("evaluate", runs, "--truth", DATA, "-o", tmp_path / "e", code=2)
    assert "there is no ground truth of coco" in capsys.readouterr().err
    run("evaluate", runs, *NAMED[:2], "--truth", TRUTHS["lvis"], "-o", tmp_path / "e", code=2)
    assert "TASK=PATH once for each task" in capsys.readouterr().err
    run("evaluate", runs, "--truth", "coco=/nowhere", "-o", tmp_path / "e", code=2)
    assert "/nowhere" in capsys.readouterr().err
    run("evaluate", runs, *NAMED, "-o", folder / "evals" / "coco", code=2)
    assert "cannot hold the evaluations of several tasks" in capsys.readouterr().err
    run("evaluate", runs, *NAMED, "--camera-model", "none", "-o", tmp_path / "e", code=2)
    assert "--camera-model is for depth alone" in capsys.readouterr().err
    shutil.copytree(runs / "lvis", tmp_path / "wrong" / "coco")
    run("evaluate", tmp_path / "wrong", *NAMED[:2], "-o", tmp_path / "e", code=2)
    assert "coco/ holds another run; found: lvis" in capsys.readouterr().err
    assert not (tmp_path / "e").exists()


@pytest.mark.blender
def test_thresholds_hold_for_the_tasks_that_have_the_metric(folder, tmp_path, capsys):
    both = (folder / "evals", folder / "evals")
    run("compare", *both, "-o", tmp_path / "a", "--draws", 20, "--fail-below", "APr=0.1", code=3)
    below = capsys.readouterr().err
    assert below.count("below its threshold") == 1
    assert "APr" in below
    run("compare", *both, "-o", tmp_path / "b", "--draws", 20, "--fail-below", "AP=0.1", code=3)
    assert capsys.readouterr().err.count("below its threshold") == 2
    run("compare", *both, "-o", tmp_path / "c", "--fail-below", "nothing=0.1", code=2)
    assert not (tmp_path / "c").exists()


@pytest.mark.blender
def test_sides_must_be_of_one_kind_and_share_a_task(folder, tmp_path):
    evals = folder / "evals"
    some = {task: legoworld.Evaluation.open(evals / task) for task in TRUTHS}
    one = legoworld.ByTask(folder=evals, results={"coco": some["coco"]})
    other = legoworld.ByTask(folder=evals, results={"lvis": some["lvis"]})
    with pytest.raises(UsageError, match="no task was evaluated on two sides"):
        legoworld.compare([one, other], tmp_path / "c")
    with pytest.raises(UsageError, match="of one task and of several"):
        legoworld.compare([one, evals / "coco"], tmp_path / "c")  # type: ignore[list-item]


@pytest.mark.blender
def test_page_evidence_and_shards_of_several_tasks(folder, tmp_path, capsys):
    run("report", folder / "evals", "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "COCO boxes" in page
    assert "LVIS masks" in page
    run("report", folder / "comparisons", "-o", tmp_path / "compared.html")
    capsys.readouterr()
    run("evidence", "verify", folder / "evals", "--json")
    checks = json.loads(capsys.readouterr().out)["checks"]
    assert {check["what"].partition(":")[0] for check in checks} == set(TRUTHS)
    run("evidence", "verify", folder / "comparisons")
    scenes = catalog.folder("examples")
    words = ("readout", scenes, *TASKS, "--track", folder / "tracks", "-q")
    for i in (1, 2):
        run(*words, "--shard", f"{i}/2", "-o", tmp_path / f"{i}")
    run("merge", tmp_path / "1", tmp_path / "2", "-o", tmp_path / "whole")
    for task in TRUTHS:
        assert results(tmp_path / "whole" / task) == results(folder / "runs" / task)


@pytest.mark.blender
def test_a_reader_of_several_tasks_draws_a_scene_once(folder):
    coffee = catalog.folder("examples") / "coffee"
    with legoworld.Reader(task=["coco", "lvis"], track=folder / "tracks", workers=1) as reader:
        (reading,) = reader.read([coffee])
    alone = legoworld.open_scene(coffee)
    assert reading.view is reading.views["coco"]
    assert reading.views["coco"].instance is reading.views["lvis"].instance
    for task, view in reading.views.items():
        assert view.predictions(7) == alone.view(task=task).predictions(7)
    with pytest.raises(UsageError, match="needs one"):
        legoworld.Reader(task=[])
    with pytest.raises(UsageError, match="need their tasks"):
        legoworld.Reader(track={"coco": folder / "tracks" / "coco.json"})
