"""What errors cost in AP: against mended copies in pycocotools, and against hotcoco's TIDE."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import hotcoco
import numpy as np
import pytest
from evaluation.detection_runs import random_predictions, random_truth
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from legoworld.evaluation.stored import read_evaluation
from legoworld.report.costs import side_costs
from legoworld.report.detection_images import DetectionImage, detection_images
from legoworld.report.detection_section import _findings
from legoworld.report.mended_ap import MendedAp, prediction_errors
from legoworld.report.sources import ReportInputError

from .pages import evaluate

Rows = list[dict[str, Any]]
MOVED = ("localisation", "classification")


def collect_errors(folder: Path) -> tuple[MendedAp, list[DetectionImage]]:
    side = read_evaluation(folder, unnamed="side")
    mended, images = MendedAp(side=side), list(detection_images((side,)))
    for image in images:
        mended.add(image, image.sides[0])
    return mended, images


def official_ap(truth: dict[str, Any], predictions: Rows) -> float:
    with contextlib.redirect_stdout(io.StringIO()):
        true = COCO()
        true.dataset = truth
        true.createIndex()
        scored = COCOeval(true, true.loadRes(predictions), "bbox")
        scored.evaluate()
        scored.accumulate()
        scored.summarize()
    return float(scored.stats[0])


def mended_copy(images: list[DetectionImage], key: tuple[str, int]) -> Rows:
    """All predictions, with the errors of a key mended as the docstring of mended_ap.py says."""
    rows: Rows = []
    top = max(entry.score for image in images for entry in image.sides[0].entries)
    best: dict[tuple[int, int], tuple[float, int]] = {}
    for image in images:
        answer = image.sides[0]
        told = prediction_errors(image, answer)
        for at, (found, about, _) in enumerate(told):
            free = key[0] in MOVED and about is not None and answer.errors.truth[about] != "found"
            score = answer.entries[at].score
            if found == key and free and score > best.get((image.image.id, about), (-1.0, 0))[0]:
                best[image.image.id, about] = score, at
        if key[0] == "missed":
            rows += [
                {
                    "image_id": image.image.id,
                    "category_id": key[1],
                    "bbox": list(t.bbox),
                    "score": top,
                }
                for t, state in zip(image.truths, answer.errors.truth, strict=True)
                if state == "missed" and t.category_id == key[1]
            ]  # fmt: skip
        for at, (entry, (found, about, _)) in enumerate(zip(answer.entries, told, strict=True)):
            row = {"image_id": image.image.id, "category_id": entry.category_id,
                   "bbox": list(entry.bbox), "score": entry.score}  # fmt: skip
            if found == key and best.get((image.image.id, about), (0, -1))[1] != at:
                continue
            if found == key and key[0] == "localisation":
                row["bbox"] = list(image.truths[about].bbox)
            if found == key and key[0] == "classification":
                row["category_id"] = key[1]
            rows.append(row)
    return rows


@pytest.mark.parametrize("seed", range(4))
def test_every_gain_is_what_the_official_evaluator_says_of_a_mended_copy(
    seed: int, tmp_path: Path
) -> None:
    truth = random_truth("coco", seed=seed, images=30)
    predictions = random_predictions("coco", truth, seed=seed)
    mended, images = collect_errors(
        evaluate(tmp_path, "coco", truth=truth, predictions=predictions, levels=None)
    )
    costs = mended.costs()
    kinds = set()
    for key, gain in costs.gain.items():
        if key[0] == "duplicate":  # its matches at higher thresholds are kept
            assert gain >= 0
            continue
        after = official_ap(truth, mended_copy(images, key))
        assert costs.ap is not None
        assert after - costs.ap == pytest.approx(gain, abs=1e-12), key
        kinds.add(key[0])
    assert kinds == {"background", "both", "localisation", "classification", "missed"}


def test_the_kinds_cost_what_hotcoco_s_tide_says(tmp_path: Path) -> None:
    """AP50 by kind, within 0.005; its missed objects are forgotten, where these are found."""
    truth = random_truth("coco", seed=7, images=150)
    for annotation in truth["annotations"]:
        annotation["iscrowd"] = 0
    predictions = random_predictions("coco", truth, seed=7)
    mended, _ = collect_errors(
        evaluate(tmp_path, "coco", truth=truth, predictions=predictions, levels=None)
    )
    gain = mended.costs("AP50").gain
    true = hotcoco.COCO(truth)
    scored = hotcoco.COCOeval(true, true.load_res(predictions), "bbox")
    scored.evaluate()
    tide = scored.tide_errors()
    names = {"Bkg": "background", "Both": "both", "Dupe": "duplicate", "Loc": "localisation",
             "Cls": "classification"}  # fmt: skip
    for theirs, kind in names.items():
        ours = sum(value for key, value in gain.items() if key[0] == kind)
        assert ours == pytest.approx(tide["delta_ap"][theirs], abs=0.005), kind
    missed = sum(value for key, value in gain.items() if key[0] == "missed")
    assert missed > tide["delta_ap"]["Miss"]


@pytest.mark.parametrize("task", ["lvis", "coco-masks"])
def test_masks_and_partly_annotated_categories_repeat_the_official_ap(
    task: str, tmp_path: Path
) -> None:
    mended, _ = collect_errors(evaluate(tmp_path, task, seed=3, images=30, levels=None))
    costs = mended.costs()
    assert costs.ap == pytest.approx(mended.side.detection.metrics["AP"], abs=1e-12)
    assert min(costs.gain.values()) > -1e-12
    assert max(costs.gain.values()) > 0.01


def test_images_without_an_answer_come_first(tmp_path: Path) -> None:
    statuses = {10 + 3 * i: "missing" for i in range(4, 12)}
    mended, _ = collect_errors(evaluate(tmp_path, "coco", statuses=statuses))
    (costs,) = side_costs([_findings(mended, NAMES)])
    first = costs.most[0]
    assert first.kind == "failed"
    assert first.n == 8
    assert first.text.startswith("8 of 12 images without scene: AP ")
    assert first.link == "?tab=photos&kind=failed&of=0"
    stated = mended.side.detection.metrics["AP"]
    assert stated is not None
    assert f"AP {stated:.3f}, over the 4 with one {stated + first.gain:.3f}" in first.text


def apart(categories: tuple[int, ...], images: int = 6) -> tuple[dict[str, Any], Rows]:
    """A truth with one object of each category in each image, none touching another, all found."""
    truth = random_truth("coco", seed=5, images=images)
    truth["annotations"] = [
        {"id": 1 + n * len(categories) + k, "image_id": image["id"], "category_id": category,
         "bbox": [40 * k, 10, 30, 20], "area": 600, "iscrowd": 0}
        for n, image in enumerate(truth["images"])
        for k, category in enumerate(categories)
    ]  # fmt: skip
    keys = ("image_id", "category_id", "bbox")
    return truth, [{**{k: a[k] for k in keys}, "score": 1.0} for a in truth["annotations"]]


NAMES = {5 + 2 * k: f"thing {k}" for k in range(6)}


def test_a_planted_confusion_is_what_costs_most(tmp_path: Path) -> None:
    truth, predictions = apart((5, 7, 9))
    rare = [p for p in predictions if p["category_id"] == 5]
    for one in rare[::2]:
        one["category_id"] = 7
    mended, _ = collect_errors(evaluate(tmp_path, "coco", truth=truth, predictions=predictions))
    (costs,) = side_costs([_findings(mended, NAMES)])
    (most,) = costs.most
    assert (most.kind, most.n, most.images) == ("classification", 3, 3)
    assert most.link == "?tab=photos&kind=classification&cat=5&of=0"
    assert most.text == "thing 0: taken for another category"
    assert most.gain == pytest.approx(1 - official_ap(truth, predictions), abs=1e-12)


def test_of_two_sides_each_is_told_what_tells_it_from_the_other(tmp_path: Path) -> None:
    truth, every = apart((5, 7, 9))
    neither, first_only = 5, 7
    sides = []
    for name, left_out in (("one", {neither, first_only}), ("two", {neither})):
        shown = [p for p in every if p["category_id"] not in left_out]
        folder = evaluate(tmp_path, "coco", truth=truth, predictions=shown, baseline=name)
        sides.append(collect_errors(folder)[0])
    one, two = side_costs([_findings(side, NAMES) for side in sides])
    assert [(c.kind, c.others) for c in one.most] == [("missed", 0.0)]
    assert f"&cat={first_only}&" in one.most[0].link
    assert one.most[0].gain == pytest.approx(1 / 3)
    assert two.most == ()


def test_matches_that_do_not_repeat_the_ap_are_refused(tmp_path: Path) -> None:
    folder = evaluate(tmp_path, "coco")
    mended, _ = collect_errors(folder)
    other = json.loads((folder / "summary.json").read_text())
    mended.side.detection.metrics["AP"] = other["metrics"]["AP"] + 1e-6
    with pytest.raises(ReportInputError, match=r"does? not repeat the evaluation's AP"):
        mended.costs()
    assert np.isfinite(other["metrics"]["AP"])
