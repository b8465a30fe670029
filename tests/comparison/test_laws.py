"""What must hold of any comparison: of a run with itself, swapped, shuffled, shared draws."""

from __future__ import annotations

import json

import numpy as np
import pytest
from comparison.evaluations import (
    DEPTH_NAMES,
    bad,
    compare,
    depth_prediction,
    depth_scene_and_baseline,
    evaluate,
    evaluated_depth,
    row_of,
    scene_and_baseline,
)
from evaluation.detection_runs import random_predictions, random_truth

from legoworld.comparison.compatibility import read_sides
from legoworld.comparison.verification import verify_comparison
from legoworld.evaluation.bootstrap import resample_counts
from legoworld.evaluation.detection.matching.outcomes import table_from
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.resampling import resampled_metrics


def sides_of(task, folder):
    return depth_scene_and_baseline(folder) if task == "eth3d" else scene_and_baseline(folder, task)


@pytest.mark.parametrize("task", ["coco", "lvis", "eth3d"])
def test_a_run_against_itself_differs_by_nothing_for_sure(task, tmp_path):
    scene, _ = sides_of(task, tmp_path)
    document = compare((scene, scene), tmp_path / "out")
    assert [m["name"] for m in document["methods"]] == ["scene (eval) 1", "scene (eval) 2"]
    defined = [r for r in document["pairs"][0]["rows"] if r["scene"]["value"] is not None]
    assert len(defined) > 20
    for row in defined:
        difference = row["difference"]
        assert difference["value"] == 0
        if row["scene"]["interval"] is not None:
            assert difference["interval"]["low"] == difference["interval"]["high"] == 0
            assert row["scene"] == row["baseline"]


@pytest.mark.parametrize("task", ["coco", "lvis", "eth3d"])
def test_swapping_the_sides_flips_every_sign(task, tmp_path):
    sides = sides_of(task, tmp_path)
    there = compare(sides, tmp_path / "there")["pairs"][0]
    back = compare(sides[::-1], tmp_path / "back")["pairs"][0]
    assert there["paired_image_ids"] == back["paired_image_ids"]
    flipped = 0
    for row, other in zip(there["rows"], back["rows"], strict=True):
        assert (row["metric"], row["images"]) == (other["metric"], other["images"])
        assert row["scene"] == other["baseline"]
        assert row["baseline"] == other["scene"]
        if row["difference"]["value"] is None:
            assert other["difference"]["value"] is None
            continue
        assert other["difference"]["value"] == -row["difference"]["value"]
        flipped += row["difference"]["value"] != 0
        ours, theirs = row["difference"]["interval"], other["difference"]["interval"]
        if ours is not None:
            assert theirs["low"] == pytest.approx(-ours["high"], abs=1e-12)
            assert theirs["high"] == pytest.approx(-ours["low"], abs=1e-12)
    assert flipped > 20


@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_shuffled_predictions_give_the_same_bytes(task, tmp_path):
    truth = random_truth(task, seed=5)
    scene = random_predictions(task, truth, seed=6, levels=1)
    baseline = random_predictions(task, truth, seed=7, levels=4)
    texts = []
    for k, random in enumerate((None, np.random.default_rng(0))):
        shuffled = [
            p if random is None else [p[i] for i in random.permutation(len(p))]
            for p in (scene, baseline)
        ]
        folder = tmp_path / str(k)
        sides = (
            evaluate(folder / "scene", task, truth, shuffled[0]),
            evaluate(folder / "other", task, truth, shuffled[1], kind="baseline"),
        )
        compare(sides, folder / "out")
        names = sorted(p.name for p in (folder / "out").iterdir())
        assert len(names) == 8
        texts.append(
            [(n, (folder / "out" / n).read_bytes()) for n in names if n != "evidence.json"]
        )
    assert texts[0] == texts[1]


@pytest.mark.parametrize("task", ["coco", "eth3d"])
def test_the_same_evaluations_give_the_same_bytes_wherever_they_lie(task, tmp_path):
    found = []
    for name in ("one", "two"):
        sides = sides_of(task, tmp_path / name)
        compare(sides, tmp_path / name / "out")
        found.append({p.name: p.read_bytes() for p in (tmp_path / name / "out").iterdir()})
    for name in set(found[0]) - {"evidence.json"}:
        assert found[0][name] == found[1][name]
    evidence = [json.loads(f["evidence.json"]) for f in found]
    for one in evidence:  # runs and truths were hashed where they lay: paths are relative
        for entry in one["inputs"]:
            assert entry["path"].startswith("../")
    assert evidence[0]["pairs"] == evidence[1]["pairs"]
    if task == "coco":
        assert evidence[0] == evidence[1]


def test_sharing_the_draws_narrows_the_interval_of_correlated_sides(tmp_path):
    """The baseline is the scene and a little more: what images are drawn moves both alike."""
    truth = random_truth("coco", seed=8, images=40)
    predictions = random_predictions("coco", truth, seed=9)
    scene = evaluate(tmp_path / "s", "coco", truth, predictions)
    fewer = [p for k, p in enumerate(predictions) if k % 9]
    other = evaluate(tmp_path / "b", "coco", truth, fewer, kind="baseline")
    document = compare((scene, other), tmp_path / "out", draws=300)
    found = row_of(document, "AP", "attempted")["difference"]["interval"]
    tables = [table_from(s.matches) for s in read_sides((scene, other))]
    protocol = detection_protocol("coco")
    independent = (
        resampled_metrics(tables[0], protocol, resample_counts(40, 300, seed=0))["AP"]
        - resampled_metrics(tables[1], protocol, resample_counts(40, 300, seed=1))["AP"]
    )
    low, high = np.quantile(independent, [0.025, 0.975])
    assert found["high"] - found["low"] < 0.7 * (high - low)


@pytest.mark.parametrize("task", ["coco", "eth3d"])
def test_without_a_paired_image_there_are_no_paired_numbers(task, tmp_path):
    if task == "coco":
        truth = random_truth(task, seed=5)
        ids = [i["id"] for i in truth["images"]]
        statuses = [dict.fromkeys(ids[::2], "missing"), dict.fromkeys(ids[1::2], "missing")]
        predictions = random_predictions(task, truth, seed=6)
        sides = [
            evaluate(tmp_path / str(k), task, truth, predictions, statuses=s, kind="baseline")
            for k, s in enumerate(statuses)
        ]
    else:
        found = depth_prediction(0.3, seed=1)
        parts = (DEPTH_NAMES[:2], DEPTH_NAMES[2:])
        sides = [
            evaluated_depth(tmp_path / str(k), {**found, **dict.fromkeys(part, "missing")})
            for k, part in enumerate(parts)
        ]
    document = compare(sides, tmp_path / "out")
    pair = document["pairs"][0]
    assert pair["coverage"]["paired"] == 0
    assert pair["paired_image_ids"] == []
    assert len(pair["dropped"]) == len(document["images"])
    images = {"coco": {"attempted"}, "eth3d": {"attempted", "scored"}}[task]
    assert {r["images"] for r in pair["rows"]} == images
    assert not bad(verify_comparison(tmp_path / "out", None))


def test_more_baselines_do_not_change_a_pair(tmp_path):
    scene, baseline = scene_and_baseline(tmp_path, "coco")
    truth = random_truth("coco", seed=1)
    third = evaluate(
        tmp_path / "third", "coco", truth, random_predictions("coco", truth, seed=44),
        kind="baseline", baseline="another",
    )  # fmt: skip
    alone = compare((scene, baseline), tmp_path / "alone")
    both = compare((scene, third, baseline), tmp_path / "both")
    assert [p["baseline"] for p in both["pairs"]] == ["another", "specialist"]
    assert both["pairs"][1] == alone["pairs"][0]
    assert [m["role"] for m in both["methods"]] == ["scene", "baseline", "baseline"]
    table = (tmp_path / "both" / "table.md").read_text()
    assert table.startswith("| task | metric | method | value | against | its value |")
    coverage = (tmp_path / "both" / "coverage.csv").read_text().splitlines()
    assert len(coverage) == 3
