"""per_image.jsonl, per_category.jsonl and view/ of a detection evaluation."""

from __future__ import annotations

from typing import Any

import numpy as np

from legoworld.evaluation.accumulation import truths_per_category
from legoworld.evaluation.folder import Row, number
from legoworld.evaluation.matched_metrics import image_rows
from legoworld.evaluation.matching import FALSE_POSITIVE, IGNORED, TRUE_POSITIVE
from legoworld.evaluation.predictions import Predictions
from legoworld.evaluation.problem import Ints
from legoworld.evaluation.run import Run
from legoworld.evaluation.scoring import Score, category_precision
from legoworld.evaluation.truth import Truth

_OUTCOMES = {FALSE_POSITIVE: "fp", TRUE_POSITIVE: "tp", IGNORED: "ignored"}


def per_image_rows(run: Run, predictions: Predictions, score: Score) -> list[Row]:
    """One row for every attempted image, ascending id."""
    problem, table = score.problem, score.table
    n = len(problem.image_ids)
    predicted = np.searchsorted(problem.image_ids, predictions.entries.image_id)
    n_predictions = np.bincount(predicted, minlength=n)
    n_kept = np.bincount(problem.detections.image, minlength=n)
    n_unverified = np.bincount(problem.detections.image[~problem.detections.verified], minlength=n)
    n_ignored = np.bincount(problem.truths.image[problem.truths.ignored], minlength=n)
    outcomes = {
        name: np.bincount(table.image[table.state[0, 0] == kind], minlength=n)
        for kind, name in _OUTCOMES.items()
    }
    aware, agnostic = image_rows(score.aware), image_rows(score.agnostic)
    rows = []
    for k, image in enumerate(run.images):
        del aware[k]["n_hits_right_label"]
        rows.append(
            {
                "image_id": image.id,
                "file_name": image.file_name,
                "status": image.status,
                "scored": image.status == "ok",
                "n_truth": int(aware[k]["n_gt"]),
                "n_ignored_truth": int(n_ignored[k]),
                "n_predictions": int(n_predictions[k]),
                "n_lost_to_cap": int(n_predictions[k] - n_kept[k]),
                "n_unverified": int(n_unverified[k]),
                "greedy_50": {name: int(found[k]) for name, found in outcomes.items()},
                "class_aware": aware[k],
                "class_agnostic": agnostic[k],
            }
        )
    return rows


def per_category_rows(truth: Truth, score: Score) -> list[Row]:
    """One row for every category that has truth or predictions, ascending id."""
    table = score.table
    n = len(table.category_ids)
    n_truths = truths_per_category(table)[0]
    cells = table.n_truths[0] > 0
    n_images = np.bincount(table.truth_category[cells], minlength=n)
    n_predictions = np.bincount(table.category, minlength=n)
    outcomes = {
        name: np.bincount(table.category[table.state[0, 0] == kind], minlength=n)
        for kind, name in _OUTCOMES.items()
    }
    iou_sum = np.bincount(score.aware.cell_category, score.aware.cell_iou_sum, minlength=n)
    precision = category_precision(score.curves)
    recall = np.where(n_truths > 0, score.curves.recall[:, :, 0, -1].mean(axis=0), np.nan)
    by_id = {c["id"]: c for c in truth.categories}
    rows = []
    for k in np.flatnonzero((n_truths > 0) | (n_predictions > 0)):
        category = by_id[int(table.category_ids[k])]
        row: Row = {
            "category_id": category["id"],
            "name": category["name"],
            "n_truth": int(n_truths[k]),
            "n_images": int(n_images[k]),
            "n_predictions": int(n_predictions[k]),
            **{
                name: number(float(precision[k, i]))
                for i, name in enumerate(("AP", "AP50", "AP75"))
            },
            "AR": number(float(recall[k])),
            "greedy_50": {name: int(found[k]) for name, found in outcomes.items()},
            "miou_gt": number(iou_sum[k] / n_truths[k]) if n_truths[k] else None,
        }
        if "frequency" in category:
            row["frequency"] = category["frequency"]
        rows.append(row)
    return rows


def views(truth: Truth, predictions: Predictions, score: Score) -> dict[str, Any]:
    """truth.json and predictions.json of the track: what a report draws over the photos."""
    problem = score.problem
    kept = np.zeros(len(predictions.entries), bool)
    kept[problem.detections.entry] = True
    outcome = np.full(len(predictions.entries), "over_cap", object)
    outcome[kept] = "unverified"
    for kind, name in _OUTCOMES.items():
        outcome[score.table.entry[score.table.state[0, 0] == kind]] = name
    pairs = _pairs_by_entry(score)
    drawn = []
    for k, entry in enumerate(predictions.entries):
        pair = pairs.get(k)
        drawn.append(
            {
                **entry,
                "outcome_50": outcome[k],
                "pair_annotation": pair[0] if pair else None,
                "pair_iou": pair[1] if pair else None,
            }
        )
    keys = ("id", "image_id", "category_id", "bbox", "segmentation", "area", "iscrowd", "ignore")
    return {
        "truth.json": {
            "images": [
                {k: i[k] for k in ("id", "file_name", "coco_url", "width", "height") if k in i}
                for i in truth.images
            ],
            "categories": [
                {k: c[k] for k in ("id", "name", "frequency") if k in c} for c in truth.categories
            ],
            "annotations": [{k: a[k] for k in keys if k in a} for a in truth.annotations],
        },
        "predictions.json": drawn,
    }


def _pairs_by_entry(score: Score) -> dict[int, tuple[int, float]]:
    """Prediction position to its class-aware pair: annotation number (from 1) and IoU."""
    pairs, problem = score.pairs_aware, score.problem
    entries: Ints = problem.detections.entry[pairs.detection]
    annotations = problem.truths.annotation[pairs.truth] + 1
    return {
        int(e): (int(a), float(iou))
        for e, a, iou in zip(entries, annotations, pairs.iou, strict=True)
    }
