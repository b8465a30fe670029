"""Error kinds: TIDE's definitions on hand-made images, and hotcoco's counts on random ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from evaluation.detection_runs import random_predictions, random_truth
from report.pages import document_of, evaluate

from legoworld.evaluation.detection.payloads.boxes import overlaps
from legoworld.report.error_kinds import ImageErrors, image_errors

CUP, BOWL = 1, 2


def explain(
    predictions: list[tuple[list[float], int, str]],
    truths: list[tuple[list[float], int]],
    ignored: tuple[int, ...] = (),
) -> ImageErrors:
    boxes, true_boxes = [p[0] for p in predictions], [t[0] for t in truths]
    iou = np.zeros((len(boxes), len(true_boxes)))
    if boxes and true_boxes:
        iou = overlaps(boxes, true_boxes, [0] * len(true_boxes))
    return image_errors(
        outcome=[p[2] for p in predictions],
        category=np.array([p[1] for p in predictions], np.int64),
        score=np.ones(len(predictions)),
        truth_category=np.array([t[1] for t in truths], np.int64),
        ignored=np.isin(np.arange(len(truths)), ignored),
        iou=iou,
    )


TRUTH: tuple[list[float], int] = ([0, 0, 100, 100], CUP)


@pytest.mark.parametrize(
    ("box", "category", "kind", "state"),
    [
        ([0, 0, 100, 90], BOWL, "classification", "reached"),
        ([0, 0, 100, 40], CUP, "localisation", "reached"),
        ([0, 0, 100, 40], BOWL, "both", "missed"),
        ([0, 0, 100, 5], CUP, "background", "missed"),
        ([300, 300, 9, 9], CUP, "background", "missed"),
    ],
)
def test_a_lone_false_positive(box: list[float], category: int, kind: str, state: str) -> None:
    errors = explain([(box, category, "fp")], [TRUTH])
    assert errors.kind == (kind,)
    assert errors.truth == (state,)
    assert errors.counts()[kind] == 1
    assert errors.counts()["missed"] == (state == "missed")


def test_a_second_prediction_on_a_found_truth_is_a_duplicate() -> None:
    found = ([0.0, 0.0, 100.0, 95.0], CUP, "tp")
    again = ([0.0, 0.0, 100.0, 90.0], CUP, "fp")
    errors = explain([found, again], [TRUTH])
    assert errors.kind == (None, "duplicate")
    assert errors.about == (0, 0)
    assert errors.iou == pytest.approx((0.95, 0.9))
    assert errors.finder == (0,)
    assert errors.truth == ("found",)


def test_a_truth_of_another_category_reached_twice_is_counted_once_as_reached() -> None:
    errors = explain([([0, 0, 100, 90], BOWL, "fp"), ([0, 0, 100, 40], CUP, "fp")], [TRUTH])
    assert errors.kind == ("classification", "localisation")
    assert errors.truth == ("reached",)


def test_ignored_truths_are_neither_missed_nor_met() -> None:
    errors = explain([([0, 0, 100, 99], CUP, "fp")], [TRUTH], ignored=(0,))
    assert errors.truth == ("ignored",)
    assert errors.kind == ("background",)


def test_nothing_predicted_and_nothing_true() -> None:
    assert explain([], [TRUTH]).counts()["missed"] == 1
    assert set(explain([], []).counts().values()) == {0}
    assert explain([([0, 0, 9, 9], CUP, "fp")], []).kind == ("background",)


@pytest.mark.parametrize("seed", range(4))
def test_counts_agree_with_hotcoco_s_tide(tmp_path: Any, seed: int) -> None:
    """Another implementation of TIDE, over all images, truth without crowds."""
    import hotcoco

    truth = random_truth("coco", seed=seed, images=30)
    for annotation in truth["annotations"]:
        annotation["iscrowd"] = 0
    predictions = random_predictions("coco", truth, seed=seed)
    evaluation = evaluate(
        tmp_path, "coco", truth=truth, predictions=predictions, kind="baseline", baseline="random"
    )
    mine = document_of(evaluation).sections[0].errors[0].counts

    coco = hotcoco.COCO(truth)
    results = coco.load_res([dict(p) for p in predictions])
    judge = hotcoco.COCOeval(coco, results, "bbox")
    judge.evaluate()
    theirs = judge.tide_errors(pos_thr=0.5, bg_thr=0.1)["counts"]
    names = {
        "classification": "Cls", "localisation": "Loc", "both": "Both",
        "duplicate": "Dupe", "background": "Bkg", "missed": "Miss",
    }  # fmt: skip
    assert {kind: theirs[names[kind]] for kind in mine} == mine
    assert min(mine.values()) > 0
