"""The numbers of a comparison against the official evaluators, evaluate, and plain arithmetic."""

from __future__ import annotations

import json

import numpy as np
import pytest
from comparison.evaluations import (
    DEPTH_NAMES,
    compare,
    depth_scene_and_baseline,
    evaluate,
    row_of,
    scene_and_baseline,
)
from evaluation.detection_runs import checked, random_truth, read_rows
from evaluation.official import official_with_ids

from legoworld.comparison.compatibility import read_sides
from legoworld.comparison.detections import detection_metrics, restrict_counts, restrict_table
from legoworld.evaluation.bootstrap import centred_interval, resample_counts, resampled_means
from legoworld.evaluation.detection.evaluators import run_evaluator
from legoworld.evaluation.detection.inputs.predictions import with_equal_confidence
from legoworld.evaluation.detection.matching.matched_metrics import matched_metrics
from legoworld.evaluation.detection.matching.outcomes import EQUAL, OWN, counts_from, table_from
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.resampling import resampled_metrics
from legoworld.records.base import as_json


def official_on(folder, task, evaluation, image_ids, *, equal):
    """The official evaluator on those images alone: truth, predictions and its image list."""
    truth = json.loads((evaluation.parent / "truth.json").read_text())
    truth["images"] = [i for i in truth["images"] if i["id"] in image_ids]
    truth["annotations"] = [a for a in truth["annotations"] if a["image_id"] in image_ids]
    found = json.loads((evaluation.parent / "run" / "predictions.json").read_text())
    kept = [p for p in found if p["image_id"] in image_ids]
    protocol, read, predictions = checked(folder, task, truth, kept)
    if equal:
        predictions = with_equal_confidence(predictions)
    return run_evaluator(read, predictions, protocol, "official").official


@pytest.mark.parametrize("task", ["coco", "lvis"])
@pytest.mark.parametrize("policy", ["", "equal_confidence."])
def test_paired_numbers_are_the_official_evaluators_on_the_paired_images(task, policy, tmp_path):
    sides = scene_and_baseline(tmp_path, task)
    document = compare(sides, tmp_path / "out", draws=4)
    paired = document["pairs"][0]["paired_image_ids"]
    assert 0 < len(paired) < 10
    metrics = detection_protocol(task).metrics
    for name, evaluation in zip(("scene", "baseline"), sides, strict=True):
        rows = [row_of(document, policy + m.name, "paired")[name]["value"] for m in metrics]
        ours = [-1.0 if value is None else value for value in rows]
        again = official_on(
            tmp_path / f"{name} alone", task, evaluation, paired, equal=bool(policy)
        )
        assert ours == pytest.approx(again, abs=1e-12)
        entries = json.loads((evaluation / "view" / "predictions.json").read_text())
        keys = ("image_id", "category_id", "bbox", "segmentation")
        results = [
            {**{k: e[k] for k in keys if k in e}, "score": 1.0 if policy else e["score"]}
            for e in entries
        ]
        told = official_with_ids(evaluation, task, paired, results)
        assert ours == pytest.approx(told, abs=1e-12)


@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_attempted_numbers_and_intervals_are_evaluates_own(task, tmp_path):
    """With its 20 draws and its seed."""
    sides = scene_and_baseline(tmp_path, task)
    document = compare(sides, tmp_path / "out", draws=20)
    for name, evaluation in zip(("scene", "baseline"), sides, strict=True):
        summary = json.loads((evaluation / "summary.json").read_text())
        matched = {
            f"{kind}.{k}": v for kind, found in summary["matched"].items() for k, v in found.items()
        }
        for metric, value in {**summary["metrics"], **matched}.items():
            if metric.split(".")[-1].startswith("n_"):
                continue
            row = row_of(document, metric, "attempted")[name]
            assert row["value"] == pytest.approx(value, abs=1e-12)
            interval = summary["intervals"][metric]
            if row["interval"] is None:
                assert interval["low"] is None
            else:
                assert row["interval"] == pytest.approx(interval, abs=1e-12)
        ties = row_of(document, "tie_orders.AP", "attempted")[name]
        expected = summary["equal_confidence"]["ties"]
        assert [ties["value"], ties["sd"]] == pytest.approx([expected["expected"], expected["sd"]])


@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_a_selection_of_images_is_weights_of_zero_and_one(task, tmp_path):
    """The table of some images and the whole table with the others weighted 0 say the same."""
    (side, *_) = read_sides(scene_and_baseline(tmp_path, task))
    arrays = side.matches
    protocol = detection_protocol(task)
    kept = np.arange(12) % 3 != 1
    frequencies = np.array(["rcf"[k % 3] for k in range(6)])
    few = resample_counts(int(kept.sum()), 9, seed=3)
    all_images = np.zeros((9, 12), np.int32)
    all_images[:, kept] = few
    for policy in (OWN, EQUAL):
        table = table_from(arrays, policy)
        whole = resampled_metrics(table, protocol, all_images, frequencies)
        part = resampled_metrics(restrict_table(table, kept), protocol, few, frequencies)
        for name in whole:
            np.testing.assert_allclose(part[name], whole[name], rtol=0, atol=1e-15)
    counts = counts_from(arrays, class_aware=True)
    whole = matched_metrics(counts, all_images)
    part = matched_metrics(restrict_counts(counts, kept), few)
    for name in whole:
        np.testing.assert_allclose(part[name], whole[name], rtol=1e-14)


def test_the_interval_of_a_difference_is_that_of_the_samples_differences(tmp_path):
    sides = scene_and_baseline(tmp_path, "coco")
    document = compare(sides, tmp_path / "out", draws=50, seed=7)
    protocol = detection_protocol("coco")
    scene, baseline = (table_from(s.matches) for s in read_sides(sides))
    counts = resample_counts(12, 50, seed=7)
    samples = [resampled_metrics(t, protocol, counts)["AP"] for t in (scene, baseline)]
    row = row_of(document, "AP", "attempted")
    difference = row["scene"]["value"] - row["baseline"]["value"]
    assert row["difference"]["value"] == difference
    spread = np.quantile(samples[0] - samples[1], [0.025, 0.975])
    middle = np.mean(samples[0] - samples[1])
    found = row["difference"]["interval"]
    expected = spread - middle + difference
    assert [found["low"], found["high"]] == pytest.approx(expected, abs=1e-12)
    assert found["bootstrap_mean"] == pytest.approx(middle)
    alone = centred_interval(samples[0], row["scene"]["value"], unit="image")
    assert row["scene"]["interval"] == pytest.approx(as_json(alone), abs=1e-12)


def test_every_number_of_a_constructed_pair(tmp_path):
    """AP by hand, one category. The scene lacks b and d, the baseline c; d has no truth."""
    truth = random_truth("coco", seed=1, images=4, categories=1, per_image=0)
    a, b, c, d = (i["id"] for i in truth["images"])
    boxes = {a: [10, 10, 40, 30], b: [20, 10, 35, 35], c: [5, 5, 50, 50]}
    truth["annotations"] = [
        {"id": k + 1, "image_id": i, "category_id": 5, "bbox": box, "area": box[2] * box[3],
         "iscrowd": 0, "segmentation": []}
        for k, (i, box) in enumerate(boxes.items())
    ]  # fmt: skip
    hits = [
        {"image_id": i, "category_id": 5, "bbox": box, "score": 1.0} for i, box in boxes.items()
    ]
    far = {"image_id": a, "category_id": 5, "bbox": [100, 60, 5, 5], "score": 0.9}
    scene = evaluate(tmp_path / "s", "coco", truth, hits, statuses={b: "missing", d: "timeout"})
    other = evaluate(
        tmp_path / "b", "coco", truth, [*hits[:2], far], statuses={c: "failed"}, kind="baseline"
    )
    document = compare((scene, other), tmp_path / "out")
    pair = document["pairs"][0]
    assert pair["paired_image_ids"] == [a]
    assert pair["dropped"] == [
        {"image_id": b, "file_name": "001.jpg", "reasons": ["scene: missing"]},
        {"image_id": c, "file_name": "002.jpg", "reasons": [f"{other.name}: failed"]},
        {"image_id": d, "file_name": "003.jpg", "reasons": ["no truth", "scene: timeout"]},
    ]
    assert pair["coverage"] == {
        "attempted": 4, "with_truth": 3, "scene_scored": 2, "baseline_scored": 3, "paired": 1
    }  # fmt: skip
    attempted, paired = (row_of(document, "AP", images) for images in ("attempted", "paired"))
    # Two of three truths are found, both first in the ranking: precision 1 up to recall 2/3.
    reached = np.sum(np.linspace(0, 1, 101) <= 2 / 3) / 101
    assert attempted["scene"]["value"] == pytest.approx(reached, abs=1e-12)
    assert attempted["baseline"]["value"] == pytest.approx(reached, abs=1e-12)
    assert attempted["scene"]["over"] == {"images": 4, "categories": 1, "truths": 3}
    assert paired["scene"]["value"] == paired["baseline"]["value"] == pytest.approx(1, abs=1e-12)
    assert paired["scene"]["over"] == {"images": 1, "categories": 1, "truths": 1}
    assert paired["difference"] == {"value": 0.0, "interval": None}  # one image has no spread
    small = row_of(document, "APs", "attempted")
    assert small["scene"]["value"] is None
    assert small["difference"] == {"value": None, "interval": None}
    f1 = row_of(document, "class_aware.f1_50", "attempted")
    assert f1["scene"]["value"] == pytest.approx(2 * 2 / (3 + 2))
    assert f1["baseline"]["value"] == pytest.approx(2 * 2 / (3 + 3))
    assert f1["difference"]["value"] == pytest.approx(2 * 2 / 5 - 2 * 2 / 6)
    assert f1["baseline"]["over"]["predictions"] == 3


def test_depth_means(tmp_path):
    sides = depth_scene_and_baseline(tmp_path)
    document = compare(sides, tmp_path / "out", draws=40)
    rows = [{r["file_name"]: r for r in read_rows(s / "per_image.jsonl")} for s in sides]
    scored = [[n for n in DEPTH_NAMES if "metrics" in r[n]] for r in rows]
    assert [len(s) for s in scored] == [3, 4]
    both = [n for n in DEPTH_NAMES if n in scored[0] and n in scored[1]]
    pair = document["pairs"][0]
    assert pair["paired_image_ids"] == [1, 3, 4]
    assert [d["reasons"] for d in pair["dropped"]] == [
        ["scene: missing"],
        ["no truth: 3 valid pixels", "scene: failed"],
    ]
    for k, side in enumerate(("scene", "baseline")):
        for policy in ("error_1", "exclude", "far"):
            metric = f"abs_rel.{policy}"

            def values(names, k=k, policy=policy):
                return [rows[k][n]["metrics"]["abs_rel"][policy] for n in names]

            own, all_of_them, paired = (
                row_of(document, metric, images)[side]
                for images in ("scored", "attempted", "paired")
            )
            assert own["value"] == pytest.approx(np.mean(values(scored[k])), abs=1e-15)
            assert own["over"] == {"images": len(scored[k])}
            missing = 4 - len(scored[k])
            mean = (sum(values(scored[k])) + missing * 1.0) / 4
            assert all_of_them["value"] == pytest.approx(mean, abs=1e-15)
            assert all_of_them["over"] == {"images": 4, "missing": missing}
            assert paired["value"] == pytest.approx(np.mean(values(both)), abs=1e-15)
            assert paired["over"] == {"images": 3}
            constant = [rows[k][n]["constant"]["abs_rel"][policy] for n in both]
            assert paired["constant"] == pytest.approx(np.mean(constant), abs=1e-15)
    assert {r["images"] for r in pair["rows"] if r["metric"] == "rmse_m.exclude"} == {
        "scored",
        "paired",
    }
    row = row_of(document, "abs_rel.error_1", "attempted")
    assert row["scene"]["value"] > 0.25  # one image of four counts as 1


def test_depth_intervals_draw_scenes_shared_by_both(tmp_path):
    sides = depth_scene_and_baseline(tmp_path)
    document = compare(sides, tmp_path / "out", draws=40, seed=3)
    assert document["bootstrap"]["unit"] == "scene"
    rows = [read_rows(s / "per_image.jsonl") for s in sides]
    ids = document["pairs"][0]["paired_image_ids"]
    values = np.array(
        [[r["metrics"]["abs_rel"]["error_1"] for r in one if r["image_id"] in ids] for one in rows]
    )
    groups = np.array([0, 1, 1])  # scenes a, b, b
    counts = resample_counts(2, 40, seed=3)
    samples = [resampled_means(v, groups, counts) for v in values]
    low, high = np.quantile(samples[0] - samples[1], [0.025, 0.975])
    found = row_of(document, "abs_rel.error_1", "paired")["difference"]["interval"]
    assert (found["low"], found["high"]) == pytest.approx((low, high), abs=1e-15)
    assert found["unit"] == "scene"
    summary = json.loads((sides[0] / "summary.json").read_text())
    again = compare(sides, tmp_path / "again", draws=20)
    for metric, by_policy in summary["intervals"].items():
        for policy, interval in by_policy.items():
            row = row_of(again, f"{metric}.{policy}", "scored")["scene"]
            assert row["interval"] == pytest.approx(interval, abs=1e-15)


@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_every_declared_metric_has_a_row_over_attempted_and_paired_images(task, tmp_path):
    document = compare(scene_and_baseline(tmp_path, task), tmp_path / "out", draws=3)
    ids = [m.id for m in detection_metrics(task)]
    assert len(set(ids)) == len(ids)
    rows = document["pairs"][0]["rows"]
    assert [(r["images"], r["metric"]) for r in rows] == [
        (images, i) for images in ("attempted", "paired") for i in ids
    ]
