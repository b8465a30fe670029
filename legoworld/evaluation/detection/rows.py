"""per_image.jsonl, per_category.jsonl and view/ of a detection evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.matching.matched_metrics import COLUMNS, MatchedCounts
from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    IGNORED,
    TRUE_POSITIVE,
)
from legoworld.evaluation.detection.problem import Floats, Ints
from legoworld.evaluation.detection.ranking.accumulation import Curves
from legoworld.evaluation.detection.scoring import Score
from legoworld.evaluation.run import Run
from legoworld.records.base import UNSET, number
from legoworld.records.detection import AmodalSums, CategoryRow, DetectionRow, Outcomes, PairSums

_OUTCOMES = {FALSE_POSITIVE: "fp", TRUE_POSITIVE: "tp", IGNORED: "ignored"}


def per_image_rows(
    run: Run, predictions: Predictions, score: Score, amodal: Sequence[AmodalSums] = ()
) -> list[DetectionRow]:
    """One row for every attempted image, ascending id. amodal: of each, or none."""
    problem, table, half = score.problem, score.table, score.curves.grid.half
    n = len(problem.image_ids)
    predicted = np.searchsorted(problem.image_ids, predictions.entries.image_id)
    n_predictions = np.bincount(predicted, minlength=n)
    n_kept = np.bincount(problem.detections.image, minlength=n)
    n_unverified = np.bincount(problem.detections.image[~problem.detections.verified], minlength=n)
    n_ignored = np.bincount(problem.truths.image[problem.truths.ignored], minlength=n)
    outcomes = _outcomes(table.state[0, half], table.image, n)
    aware = _image_sums(score.aware, class_aware=True)
    agnostic = _image_sums(score.agnostic, class_aware=False)
    return [
        DetectionRow(
            image_id=image.image_id,
            file_name=image.file_name,
            status=image.status,
            scored=image.status == "ok",
            n_truth=aware[k].n_gt,
            n_ignored_truth=int(n_ignored[k]),
            n_predictions=int(n_predictions[k]),
            n_lost_to_cap=int(n_predictions[k] - n_kept[k]),
            n_unverified=int(n_unverified[k]),
            greedy_50=outcomes[k],
            class_aware=aware[k],
            class_agnostic=agnostic[k],
            amodal=amodal[k] if amodal else UNSET,
        )
        for k, image in enumerate(run.images)
    ]


def _image_sums(counts: MatchedCounts, *, class_aware: bool) -> list[PairSums]:
    """The sums of each image, as per_image.jsonl holds them."""
    columns = COLUMNS[:-1] if class_aware else COLUMNS  # the last is right by construction
    of_images = []
    for row in counts.per_image:
        sums: dict[str, Any] = {
            name: float(value) if name.endswith("_sum") else int(value)
            for name, value in zip(columns, row, strict=False)
        }
        of_images.append(PairSums(**sums))
    return of_images


def per_category_rows(truth: Truth, score: Score) -> list[CategoryRow]:
    """One row for every category that has truth or predictions, ascending id."""
    table, half = score.table, score.curves.grid.half
    n = len(table.category_ids)
    n_truths = table.truths_per_category[0]
    cells = table.n_truths[0] > 0
    n_images = np.bincount(table.truth_category[cells], minlength=n)
    n_predictions = np.bincount(table.category, minlength=n)
    outcomes = _outcomes(table.state[0, half], table.category, n)
    iou_sum = np.bincount(score.aware.cell_category, score.aware.cell_iou_sum, minlength=n)
    precision = _category_precision(score.curves)
    recall = np.where(n_truths > 0, score.curves.recall[:, :, 0, -1].mean(axis=0), np.nan)
    by_id = {c["id"]: c for c in truth.categories}
    rows = []
    for k in np.flatnonzero((n_truths > 0) | (n_predictions > 0)):
        category = by_id[int(table.category_ids[k])]
        ap, ap50, ap75 = (number(float(value)) for value in precision[k])
        rows.append(
            CategoryRow(
                category_id=category["id"],
                name=category["name"],
                n_truth=int(n_truths[k]),
                n_images=int(n_images[k]),
                n_predictions=int(n_predictions[k]),
                AP=ap,
                AP50=ap50,
                AP75=ap75,
                AR=number(float(recall[k])),
                greedy_50=outcomes[k],
                miou_gt=number(iou_sum[k] / n_truths[k]) if n_truths[k] else None,
                frequency=category.get("frequency", UNSET),
            )
        )
    return rows


def _category_precision(curves: Curves) -> Floats:
    """(K, 3) AP, AP50, AP75 over all areas; NaN without truth of a category, or the IoU."""
    p, undefined = curves.precision[..., 0], np.full(curves.precision.shape[2], np.nan)
    values = [p.mean(axis=(0, 1))]
    for iou in (0.5, 0.75):
        at = p[curves.grid.thresholds(iou)]
        values.append(at[0].mean(axis=0) if len(at) else undefined)
    stacked = np.stack(values, axis=1)
    return np.where(stacked < 0, np.nan, stacked)


def _outcomes(state: NDArray[np.uint8], group: Ints, n_groups: int) -> list[Outcomes]:
    """The outcome of the predictions of each group; state, group: of every prediction."""
    counts = {
        name: np.bincount(group[state == kind], minlength=n_groups).tolist()
        for kind, name in _OUTCOMES.items()
    }
    return [
        Outcomes(tp=tp, fp=fp, ignored=ignored)
        for tp, fp, ignored in zip(counts["tp"], counts["fp"], counts["ignored"], strict=True)
    ]


def views(truth: Truth, predictions: Predictions, score: Score) -> dict[str, Any]:
    """truth.json and predictions.json of the track: what a report draws over the photos."""
    problem = score.problem
    outcome = np.full(len(predictions.entries.score), "over_cap", object)
    outcome[problem.detections.entry] = "unverified"
    state = score.table.state[0, score.curves.grid.half]
    for kind, name in _OUTCOMES.items():
        outcome[score.table.entry[state == kind]] = name
    pairs = _pairs_by_entry(score)
    drawn = []
    for k, entry in enumerate(predictions.entries.documents()):
        annotation, iou = pairs.get(k, (None, None))
        found = {"outcome_50": outcome[k], "pair_annotation": annotation, "pair_iou": iou}
        drawn.append({**entry, **found})
    keys = (
        "id", "image_id", "category_id", "bbox", "segmentation", "visible_mask", "area",
        "iscrowd", "ignore", "bbox3D",
    )  # fmt: skip
    of_image = ["id", "file_name", "coco_url", "width", "height"]
    if score.problem.protocol.payload.field == "bbox3D":
        of_image.append("K")
    return {
        "truth.json": {
            "images": [{k: i[k] for k in of_image if k in i} for i in truth.images],
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
