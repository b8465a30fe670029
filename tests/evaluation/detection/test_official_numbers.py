"""The numbers are the official evaluators' own, called directly on the same files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from evaluation.detection_runs import (
    by_canonical_key,
    checked,
    match_everything,
    random_predictions,
    random_truth,
)
from evaluation.official import direct, evaluate

from legoworld.evaluation.detection.evaluators import EvaluatorDisagreesError, run_evaluator
from legoworld.evaluation.detection.inputs.prediction_columns import make_columns
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.scoring import category_frequencies, check_agreement
from legoworld.evaluation.detection.text import official_lines
from legoworld.records.base import to_record
from legoworld.records.predictions import Prediction


@pytest.mark.parametrize("levels", [None, 3, 1])
@pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis"])
@pytest.mark.parametrize("kind", ["official", "fast"])
def test_random_runs(task, levels, kind, tmp_path):
    truth = random_truth(task, seed=3)
    predictions = random_predictions(task, truth, seed=4, levels=levels)
    evaluation = evaluate(tmp_path, task, truth, predictions, evaluator=kind)
    ordered = sorted(predictions, key=by_canonical_key)
    numbers, lines = direct(task)(tmp_path / "truth.json", ordered)
    assert evaluation.official == pytest.approx(numbers, abs=1e-12)
    protocol, *_ = checked(tmp_path / "again", task, truth, predictions)
    assert official_lines(protocol, evaluation.official) == lines


@pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis"])
@pytest.mark.parametrize("kind", ["official", "fast"])
def test_no_predictions_at_all_is_zero(task, kind, tmp_path):
    truth = random_truth(task, seed=5)
    summary = evaluate(tmp_path, task, truth, [], evaluator=kind)
    assert summary.metrics["AP"] == 0.0
    assert summary.matched.class_aware.miou_gt_micro == 0.0
    assert summary.matched.class_aware.miou_matched is None
    assert summary.coverage.scored_without_predictions == 12


@pytest.mark.parametrize("task", ["coco", "coco-masks", "lvis"])
def test_an_undefined_number_stays_minus_one_and_is_no_metric(task, tmp_path):
    truth = random_truth(task, seed=6, categories=3)
    truth["annotations"] = [a for a in truth["annotations"] if a["area"] > 32**2]
    summary = evaluate(tmp_path, task, truth, random_predictions(task, truth, seed=1))
    assert summary.official[3] == -1
    assert summary.metrics["APs"] is None
    assert summary.intervals["APs"].low is None


def test_an_evaluator_that_disagrees_is_an_error(tmp_path):
    truth = random_truth("coco", seed=3)
    protocol, read, predictions = checked(
        tmp_path, "coco", truth, random_predictions("coco", truth, seed=4)
    )
    _, table = match_everything(protocol, read, predictions)
    scores = run_evaluator(read, predictions, protocol, "fast")
    curves = accumulate(table, protocol)
    check_agreement(scores, curves, read, protocol)
    off = replace(scores, official=(scores.official[0] + 1e-9, *scores.official[1:]))
    no_precision = np.where(scores.precision < 0, np.nan, scores.precision)
    for wrong in (
        off,
        replace(scores, official=(float("nan"), *scores.official[1:])),
        replace(scores, precision=no_precision),
        replace(scores, precision=scores.precision + 1e-9),
    ):
        with pytest.raises(EvaluatorDisagreesError):
            check_agreement(wrong, curves, read, protocol)


REAL = [
    ("coco", "bbox", "coco/instances_val2017_188",
     "coco/yolox_nano_val2017_188_results", 0.28078518),
    ("coco", "bbox", "evaluators/instances_val2014_100",
     "evaluators/instances_val2014_fakebbox100_results", 0.504581),
    ("coco-masks", "segm", "evaluators/instances_val2014_100",
     "evaluators/instances_val2014_fakesegm100_results", 0.319545),
    ("lvis", "segm", "lvis/lvis_val_100", "lvis/lvis_val_100_synthetic_results", 0.305714),
]  # fmt: skip


@pytest.mark.real_data
@pytest.mark.parametrize(("task", "iou_type", "truth", "results", "ap"), REAL)
def test_real_files(task, iou_type, truth, results, ap, real_data, tmp_path):
    """In file order the published AP; in canonical order what the evaluator says of that order."""
    truth_path = real_data / f"{truth}.json"
    document = json.loads(truth_path.read_text(encoding="utf-8"))
    entries = json.loads((real_data / f"{results}.json").read_text(encoding="utf-8"))
    run_entries = [dict(e) for e in entries]
    protocol, read, predictions = checked(tmp_path, task, document, run_entries)
    assert protocol.iou_type == iou_type
    in_file_order, _ = direct(task)(truth_path, entries)
    assert in_file_order[0] == pytest.approx(ap, abs=1e-6)
    numbers, lines = direct(task)(truth_path, predictions.entries.results())
    _, table = match_everything(protocol, read, predictions)
    curves = accumulate(table, protocol)
    ours = [metric_value(m, curves, category_frequencies(read)) for m in protocol.metrics]
    assert ours == pytest.approx(numbers, abs=1e-12)
    for kind in ("official", "fast"):
        scores = run_evaluator(read, predictions, protocol, kind)
        assert scores.official == pytest.approx(numbers, abs=1e-12)
        assert np.abs(scores.precision - curves.precision).max() <= 1e-12
        assert official_lines(protocol, scores.official) == lines


@pytest.mark.real_data
def test_the_official_lines_of_the_reference_sample(real_data, tmp_path):
    """All twelve printed numbers of cocoapi's own results file, of boxes and of masks."""
    printed = (real_data / "evaluators/val2014_fake_eval_res.txt").read_text(encoding="utf-8")
    truth_path = real_data / "evaluators/instances_val2014_100.json"
    document = json.loads(truth_path.read_text(encoding="utf-8"))
    for iou_type in ("bbox", "segm"):
        block = printed.split(f"type={iou_type}\n")[1].split("-----")[0]
        expected = [float(x.rsplit("=", 1)[1]) for x in block.splitlines() if "@[" in x]
        path = real_data / f"evaluators/instances_val2014_fake{iou_type}100_results.json"
        entries = json.loads(path.read_text(encoding="utf-8"))
        task = {"bbox": "coco", "segm": "coco-masks"}[iou_type]
        protocol, read, predictions = checked(tmp_path / iou_type, task, document, [])
        own = replace(predictions, entries=make_columns(to_record(list[Prediction], entries)))
        scores = run_evaluator(read, own, protocol, "official")
        assert [round(x, 3) for x in scores.official] == expected


@pytest.mark.parametrize(
    ("side", "areas"), [(32, "sm"), (96, "ml"), (31, "s"), (33, "m"), (97, "l")]
)
def test_an_area_on_a_border_is_in_both_ranges(side, areas, tmp_path):
    """COCOeval ignores area < low and area > high: 1024 is small and medium."""
    truth = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": 120, "height": 90 + side}],
        "categories": [{"id": 5, "name": "thing"}],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 5, "bbox": [3, 4, side, side],
                         "area": side * side, "iscrowd": 0}],
    }  # fmt: skip
    found = [{"image_id": 1, "category_id": 5, "score": 1.0, "bbox": [3, 4, side, side]}]
    metrics = evaluate(tmp_path, "coco", truth, found).metrics
    assert "".join(name for name in "sml" if metrics[f"AP{name}"] is not None) == areas
    assert [metrics[f"AP{name}"] for name in areas] == pytest.approx([1.0] * len(areas))
