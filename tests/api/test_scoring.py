"""Scores in memory: the official numbers, of views, lists and arrays, from one process."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

import legoworld
from legoworld.errors import SceneMissingError, UsageError
from legoworld.tasks.shipped import TASKS, PolicyTask, TaskName

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "examples"
TRUTH = ROOT / "datasets" / "skimage_examples" / "truth_coco.json"
BY_ID = {1: "astronaut", 2: "chelsea", 3: "coffee", 4: "motorcycle"}


def official(results):
    """pycocotools by itself, over a file of these results."""
    with contextlib.redirect_stdout(io.StringIO()):
        true = COCO(str(TRUTH))
        evaluation = COCOeval(true, true.loadRes([dict(r) for r in results]), "bbox")
        for step in (evaluation.evaluate, evaluation.accumulate, evaluation.summarize):
            step()
    names = ("AP", "AP50", "AP75", "APs", "APm", "APl", "AR1", "AR10", "AR100", "ARs", "ARm", "ARl")
    return {n: None if v == -1 else float(v) for n, v in zip(names, evaluation.stats, strict=True)}


@pytest.fixture(scope="module")
def truth():
    return legoworld.Truth.open(TRUTH, task="coco")


@pytest.fixture(scope="module")
def views(truth):
    return {
        image_id: legoworld.open_scene(SCENES / name).view(
            task="coco", size_wh=truth.sizes_wh[image_id]
        )
        for image_id, name in BY_ID.items()
    }


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluated")
    track = ROOT / "datasets" / "skimage_examples" / "track_coco.json"
    legoworld.readout(SCENES, folder / "run", task="coco", track=track, workers=1)
    return legoworld.evaluate(folder / "run", folder / "e", truth=TRUTH, draws=5)


def test_views_score_what_their_run_scores(views, truth, evaluated):
    found = legoworld.score(views, truth)
    assert found.metrics == evaluated.metrics
    assert found.evaluator == "pycocotools 2.0.11"
    assert found.n_images == evaluated.coverage.attempted == 4
    assert found.table[0]["metric"] == "AP"
    results = [entry for i, view in views.items() for entry in view.predictions(i)]
    stored = json.loads((evaluated.folder.parent / "run" / "predictions.json").read_text())
    assert sorted(results, key=str) == sorted(stored, key=str)
    for answers in (stored, results, results[::-1]):
        assert legoworld.score(answers, TRUTH, task="coco").metrics == official(answers)
    assert legoworld.score([], truth).metrics["AP"] == 0


def test_views_evaluate_and_compare_as_their_run_does(views, truth, evaluated, tmp_path):
    found = legoworld.evaluate(views, tmp_path / "own", truth=truth, task="coco", draws=5)
    assert found.metrics == evaluated.metrics
    assert found.table == evaluated.table  # the same intervals
    assert found.coverage == evaluated.coverage
    assert found.per_image() == evaluated.per_image()
    assert {p.name for p in (tmp_path / "own").iterdir()} == {"run", "track.json", "evaluation"}
    assert all(c.status == "ok" for c in legoworld.evidence_verify(found.folder))
    again = legoworld.evaluate(views, tmp_path / "own", truth=TRUTH, task="coco", draws=5)
    assert again.summary == found.summary
    results = [{**entry, "score": 0.5} for i in BY_ID for entry in views[i].predictions(i)][1:]
    sides = {"scene": views, "model": results, "folder": found}
    compared = legoworld.compare(sides, tmp_path / "both", truth=truth, draws=5)
    assert compared.folder == tmp_path / "both" / "comparison"
    first = compared.table[0]
    assert (first["scene"], first["baseline"], first["metric"]) == ("scene", "model", "AP")
    assert first["scene_value"] == found.metrics["AP"] > first["baseline_value"]
    (tmp_path / "results.json").write_text(json.dumps(results))
    legoworld.track_make(tmp_path / "track.json", truth=TRUTH, task="coco")
    imported = legoworld.baseline_import(
        tmp_path / "results.json", tmp_path / "i", task="coco", track=tmp_path / "track.json",
        category_ids="dataset",
    )  # fmt: skip
    model = legoworld.evaluate(imported.folder, tmp_path / "m", truth=TRUTH, draws=5)
    assert model.metrics["AP"] == first["baseline_value"]
    assert legoworld.compare([found, model], tmp_path / "c", draws=5).table[0] == {
        **first, "scene": "own", "baseline": "results",
    }  # fmt: skip


def test_what_was_written_for_answers_in_memory_goes_with_the_result(views, truth):
    found = legoworld.evaluate({3: views[3], 4: views[4]}, truth=truth, draws=5)
    folder = found.folder
    assert folder.is_dir()
    assert found.coverage.attempted == 2
    assert found.metrics == legoworld.score({3: views[3], 4: views[4]}, truth).metrics
    del found
    assert not folder.parent.exists()
    compared = legoworld.compare({"a": {3: views[3]}, "b": {3: views[3]}}, truth=truth, draws=5)
    assert {row["difference"] for row in compared.table} <= {0.0, None}
    assert not compared.folder.exists()


def test_arrays_evaluate_with_intervals():
    true = np.linspace(1, 3, 600 * 4, dtype=np.float32).reshape(40, 60)
    answers, truth = {1: true**1.1, 2: true**1.2}, {1: true, 2: true}
    found = legoworld.evaluate(answers, truth=truth, task="eth3d", draws=20)
    scores = legoworld.score(answers, truth, task="eth3d")
    assert found.metrics == {name: dict(values) for name, values in scores.by_policy.items()}
    assert found.table[0]["low"] < found.table[0]["value"] < found.table[0]["high"]
    up = np.zeros((4, 6, 3), np.float32)
    up[..., 1] = -1
    assert legoworld.evaluate(up, truth=up, task="normals", draws=5).metrics["mean_deg"] == {
        "error_90": 0, "exclude": 0,
    }  # fmt: skip


def test_a_folder_of_other_answers_stays_as_it_is(tmp_path):
    depth = np.linspace(1, 3, 24, dtype=np.float32).reshape(4, 6)
    pair = {1: depth, 2: depth}
    legoworld.evaluate(pair, tmp_path, truth=pair, task="eth3d", draws=5)
    files = [path for path in sorted(tmp_path.rglob("*")) if path.is_file()]
    before = [path.read_bytes() for path in files]
    for answers, truth in (({1: depth}, pair), (pair, {1: depth, 2: 2 * depth})):
        with pytest.raises(UsageError, match="other images, or another truth"):
            legoworld.evaluate(answers, tmp_path, truth=truth, task="eth3d", draws=5)
    assert [path.read_bytes() for path in files] == before
    fewer = legoworld.evaluate(
        {1: depth}, tmp_path, truth=pair, task="eth3d", draws=5, overwrite=True
    )
    assert fewer.coverage.attempted == 1


@pytest.mark.parametrize("name", ["..", "a/b", "comparison", "."])
def test_a_side_s_name_is_a_folder_s(name, tmp_path):
    depth = {1: np.ones((4, 6), np.float32)}
    sides = {name: depth, "b": depth}
    with pytest.raises(UsageError, match="such a name"):
        legoworld.compare(sides, tmp_path / "in", truth=depth, task="eth3d", draws=5)
    assert not [*tmp_path.rglob("*.json")]


def test_memory_is_evaluated_with_a_truth_of_one_task(views, truth, evaluated):
    with pytest.raises(UsageError, match="of one task"):
        legoworld.evaluate([], truth=TRUTH)
    with pytest.raises(UsageError, match="truth="):
        legoworld.compare({"a": views, "b": views})
    with pytest.raises(UsageError, match="such a name"):
        legoworld.compare({"a/b": views, "b": views}, truth=truth)
    with pytest.raises(UsageError, match="output"):
        legoworld.evaluate(evaluated.folder, truth=TRUTH)
    with pytest.raises(UsageError, match="another evaluation"):
        legoworld.Evaluation.open(evaluated.folder, task="lvis")
    arrays = np.ones((4, 6), np.float32)
    with pytest.raises(UsageError, match="no such image"):
        legoworld.evaluate({3: arrays}, truth={1: arrays, 2: arrays}, task="eth3d", draws=5)


def test_one_image_is_scored_alone(views, truth, tmp_path):
    found = legoworld.score(views[4], truth, image_id=4)
    assert found.n_images == 1
    assert legoworld.score(views[4].predictions(4), truth, image_id=4).metrics == found.metrics
    document = json.loads(TRUTH.read_text())
    document["images"] = [i for i in document["images"] if i["id"] == 4]
    document["annotations"] = [a for a in document["annotations"] if a["image_id"] == 4]
    (tmp_path / "alone.json").write_text(json.dumps(document))
    assert legoworld.score(views[4], tmp_path / "alone.json").metrics == found.metrics
    assert found.metrics["AP"] != legoworld.score(views, truth).metrics["AP"]


def test_a_reader_scores_as_it_reads(views, truth):
    scenes = {i: SCENES / name for i, name in BY_ID.items()} | {3: SCENES / "nothing"}
    with legoworld.Reader(task=["coco", "eth3d"], workers=2) as reader:
        readings = {r.image_id: r for r in reader.score(scenes, truth)}
        with pytest.raises(UsageError, match="no such image"):
            reader.score({99: SCENES / "coffee"}, truth)
    assert isinstance(readings[3].error, SceneMissingError)
    for image_id in (1, 2, 4):
        reading = readings[image_id]
        if not reading.ok:
            raise reading.error
        assert reading.scores == legoworld.score(views[image_id], truth, image_id=image_id)
        assert set(reading.views) == {"coco", "eth3d"}


def test_scenes_and_cameras_share_one_queue(tmp_path):
    cameras = legoworld.orbit(centre=(0, 0, 0), radius=2, n=3, size_wh=(30, 20))
    scenes = [SCENES / "coffee", tmp_path / "nothing", SCENES / "chelsea"]
    with legoworld.Reader(task="coco", workers=2) as reader:
        readings = list(reader.map(scenes, cameras))
        named = list(reader.map([SCENES / "coffee"], ["Camera", "Nobody"]))
        begun = reader.map(scenes, cameras)
        next(begun)
        begun.close()
    seen = sorted((r.scene.name, r.view.camera.name) for r in readings if r.ok)
    assert seen == [(s, f"orbit {n}") for s in ("chelsea", "coffee") for n in range(3)]
    assert [r.status for r in readings if not r.ok] == ["missing"]
    assert [r.ok for r in named] == [False]


def test_a_reader_leaves_the_event_loop_free():
    async def read():
        ticks, readings = 0, []

        async def tick():
            nonlocal ticks
            while True:
                ticks += 1
                await asyncio.sleep(0)

        ticking = asyncio.create_task(tick())
        with legoworld.Reader(task="coco", workers=1) as reader:
            async for reading in reader.aread([SCENES / "coffee"] * 3, size_wh=(30, 20)):
                readings.append(reading)  # noqa: PERF401
            async for _ in reader.aread([SCENES / "coffee"] * 3, size_wh=(30, 20)):
                break
        ticking.cancel()
        return ticks, readings

    ticks, readings = asyncio.run(read())
    assert [r.ok for r in readings] == [True] * 3
    assert ticks > 3


def test_arrays_score_what_their_files_score():
    true = np.linspace(1, 3, 600 * 4, dtype=np.float32).reshape(40, 60)
    truth = legoworld.Truth.open({1: true, 2: 2 * true}, task="eth3d")
    assert dict(truth.sizes_wh) == {1: (60, 40), 2: (60, 40)}
    found = legoworld.score({1: 5 * true, 2: true}, truth)
    assert found.metrics["abs_rel"] == pytest.approx(0, abs=1e-6)  # up to scale
    assert found.n_images == 2
    assert [row.status for row in found.per_image] == ["ok", "ok"]
    other = legoworld.score(np.full_like(true, 2), true, task="eth3d")
    assert other.metrics["abs_rel"] > 0.05
    assert set(other.by_policy["abs_rel"]) > {"exclude"}


def test_a_view_scores_against_its_own_arrays():
    scene = legoworld.open_scene(SCENES / "coffee")
    depth = scene.view(task="eth3d", size_wh=(60, 40))
    assert legoworld.score(depth, depth.depth_z_m).metrics["abs_rel"] == pytest.approx(0, abs=1e-6)
    turned = scene.view(task="normals", size_wh=(60, 40))
    found = legoworld.score(turned, turned.normals())
    assert found.metrics["mean_deg"] == pytest.approx(0, abs=0.1)


def test_what_cannot_be_scored(views, truth):
    depth = np.ones((4, 4), np.float32)
    for call, words in (
        (lambda: legoworld.score(views[1], truth), "which image the answer is of"),
        (lambda: legoworld.score(views[1], truth, image_id=99), "not in the truth"),
        (lambda: legoworld.score(views[1], depth, task="eth3d"), "of one task"),
        (lambda: legoworld.score(views, TRUTH, task="coco-masks"), "of one task"),
        (lambda: legoworld.score([], TRUTH), "of one task"),
        (lambda: legoworld.score([{"image_id": 1}], truth), "has no category_id"),
        (lambda: legoworld.score([{**views[1].predictions(1)[0], "category_id": 999}], truth), "9"),
        (lambda: legoworld.score({1: depth}, {2: depth}, task="eth3d"), "different images"),
        (lambda: legoworld.score("text", depth, task="eth3d"), "array in memory"),
        (lambda: legoworld.Truth.open(depth, task="coco"), "against a file"),
        (lambda: legoworld.Truth.open(TRUTH, task="bench"), "not scored in memory"),
        (lambda: legoworld.Truth.open(TRUTH, task="cocoa"), "unknown task"),
    ):
        with pytest.raises(legoworld.LegoWorldError, match=words):
            call()


def test_the_typed_names_are_the_registrys():
    assert sorted(get_args(TaskName)) == sorted(task.name for task in TASKS)
    by_policy = {task.name for task in TASKS if task.family.by_policy}
    assert set(get_args(PolicyTask)) == by_policy
