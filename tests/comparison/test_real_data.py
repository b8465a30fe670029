"""On real truth: the paired numbers are the official evaluators' on the paired images.

What is compared are a specialist's boxes with the most confident of the same boxes, and synthetic
masks with some of themselves: a check of arithmetic, not a result about anything.
"""

from __future__ import annotations

import json

import pytest
from comparison.evaluations import compare, evaluate, row_of
from evaluation.official import official_with_ids

from legoworld.evaluation.detection.protocols import detection_protocol

pytestmark = pytest.mark.real_data

FILES = {
    "coco": ("coco/instances_val2017_188", "coco/yolox_nano_val2017_188_results", 188),
    "lvis": ("lvis/lvis_val_100", "lvis/lvis_val_100_synthetic_results", 100),
}


@pytest.fixture(params=["coco", "lvis"])
def real(request, real_data, tmp_path):
    """(task, evaluations of the confident predictions at score 1 and of all, paired ids)."""
    task = request.param
    truth_file, results_file, n_images = FILES[task]
    truth = json.loads((real_data / f"{truth_file}.json").read_text(encoding="utf-8"))
    found = json.loads((real_data / f"{results_file}.json").read_text(encoding="utf-8"))
    ids = sorted(i["id"] for i in truth["images"])
    failed = dict.fromkeys(ids[3:9], "missing")
    payload = "bbox" if task == "coco" else "segmentation"
    keys = ("image_id", "category_id", payload, "score")
    ranked = [{k: p[k] for k in keys} for p in found]
    confident = sorted(ranked, key=lambda p: -p["score"])[: len(ranked) // 4]
    scene = evaluate(tmp_path / "s", task, truth, [{**p, "score": 1.0} for p in confident],
                      statuses=failed, evaluator="fast")  # fmt: skip
    other = evaluate(tmp_path / "b", task, truth, ranked, statuses={ids[20]: "failed"},
                      evaluator="fast", kind="baseline", baseline="ranked")  # fmt: skip
    assert len(ids) == n_images
    scored = {a["image_id"] for a in truth["annotations"] if not a.get("iscrowd")}
    return task, (scene, other), sorted(scored - set(failed) - {ids[20]})


def test_paired_numbers(real, tmp_path):
    task, sides, expected = real
    document = compare(sides, tmp_path / "out", draws=40)
    coverage = document["pairs"][0]["coverage"]
    assert coverage["attempted"] == FILES[task][2]
    assert coverage["scene_scored"] == FILES[task][2] - 6
    paired = document["pairs"][0]["paired_image_ids"]
    assert paired == expected
    assert coverage["paired"] == len(paired) > 80
    for name, evaluation in zip(("scene", "baseline"), sides, strict=True):
        drawn = json.loads((evaluation / "view" / "predictions.json").read_text())
        kept = [p for p in drawn if p["outcome_50"] != "over_cap"]
        keys = ("image_id", "category_id", "bbox", "segmentation")
        for prefix in ("",) if name == "scene" else ("", "equal_confidence."):
            results = [
                {**{k: p[k] for k in keys if k in p}, "score": 1.0 if prefix else p["score"]}
                for p in kept
            ]
            told = official_with_ids(evaluation, task, paired, results)
            for metric, value in zip(detection_protocol(task).metrics, told, strict=True):
                ours = row_of(document, prefix + metric.name, "paired")[name]["value"]
                assert (-1.0 if ours is None else ours) == pytest.approx(value, abs=1e-12)
    row = row_of(document, "AP", "paired")
    interval = row["difference"]["interval"]
    assert interval["low"] < row["difference"]["value"] < interval["high"]
    assert interval["high"] < 0  # a quarter of the predictions find less
