"""Matched IoU, free of scores: one-to-one pairs that maximise total overlap (Kuhn, Hungarian).

And the numbers that follow from pairs: per image, over all images, over samples;
docs/protocols/coco.md and lvis.md define them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.bootstrap import weighted_sums
from legoworld.evaluation.detection.problem import Bools, Floats, Ints, Problem
from legoworld.records.base import number
from legoworld.records.detection import Matched
from legoworld.workers.processors import core_threads

#: A pair at least this good is a true positive of precision and recall.
HIT: Final = 0.5


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Pairs of a run, or of some of its images, and what they are counted against.

    detection, truth: (P,) positions in its columns; iou: (P,), all above 0; counted: (D,)
    detections that are answered for: paired at HIT or better, or not forgiven by the official
    rules (in a crowd, on an ignored instance, category unverified or not exhaustively annotated).
    """

    detection: Ints
    truth: Ints
    iou: Floats
    counted: Bools


#: Columns of MatchedCounts.per_image. quality: pairs above HIT, panoptic quality's own rule.
COLUMNS: Final = (
    "n_gt",
    "n_dt",
    "iou_sum",
    "n_matched",
    "n_hits",
    "n_quality",
    "quality_sum",
    "n_hits_right_label",
)


@dataclass(frozen=True, kw_only=True)
class MatchedCounts:
    """Sums that every score-free number is made of.

    per_image: (images, columns) as named by `COLUMNS`. For the macro mean, per truth cell
    (image and category that have truth): cell_image, cell_category, cell_n_gt, cell_iou_sum.
    """

    per_image: Floats
    cell_image: Ints
    cell_category: Ints
    cell_n_gt: Floats
    cell_iou_sum: Floats


def matched_counts(problem: Problem, pairs: Pairs) -> MatchedCounts:
    """Sums of one run's pairs."""
    detections, truths = problem.detections, problem.truths
    n_images, n_categories = len(problem.image_ids), len(problem.category_ids)
    image = detections.image[pairs.detection]
    hit, quality = pairs.iou >= HIT, pairs.iou > HIT
    right = detections.category[pairs.detection] == truths.category[pairs.truth]
    scored = ~truths.ignored

    def per_image(which: Ints, weights: Floats | None = None) -> Floats:
        return np.bincount(which, weights, minlength=n_images).astype(np.float64)

    columns = {
        "n_gt": per_image(truths.image[scored]),
        "n_dt": per_image(detections.image[pairs.counted]),
        "iou_sum": per_image(image, pairs.iou),
        "n_matched": per_image(image),
        "n_hits": per_image(image[hit]),
        "n_quality": per_image(image[quality]),
        "quality_sum": per_image(image[quality], pairs.iou[quality]),
        "n_hits_right_label": per_image(image[hit & right]),
    }
    cells, cell = np.unique(
        truths.image[scored] * n_categories + truths.category[scored], return_inverse=True
    )
    position = np.full(len(truths.image), -1)
    position[scored] = cell
    return MatchedCounts(
        per_image=np.stack([columns[c] for c in COLUMNS], axis=1),
        cell_image=cells // n_categories,
        cell_category=cells % n_categories,
        cell_n_gt=np.bincount(cell, minlength=len(cells)).astype(np.float64),
        cell_iou_sum=np.bincount(position[pairs.truth], pairs.iou, len(cells)).astype(np.float64),
    )


def matched_metrics(counts: MatchedCounts, samples: NDArray[np.int32]) -> dict[str, Floats]:
    """Every score-free number of every sample of images: (n,), NaN where undefined.

    samples: (n, images) how often each image is in each; one row of ones is the run itself.
    """
    sums = {
        name: weighted_sums(samples, column)
        for name, column in zip(COLUMNS, counts.per_image.T, strict=True)
    }
    n_gt, n_dt, hits = sums["n_gt"], sums["n_dt"], sums["n_hits"]
    with np.errstate(invalid="ignore", divide="ignore"):
        sq = sums["quality_sum"] / sums["n_quality"]
        rq = 2 * sums["n_quality"] / (n_gt + n_dt)
        return {
            "miou_gt_micro": sums["iou_sum"] / n_gt,
            "miou_gt_macro": _macro(counts, samples),
            "miou_matched": sums["iou_sum"] / sums["n_matched"],
            "n_matched": sums["n_matched"],
            "precision_50": hits / n_dt,
            "recall_50": hits / n_gt,
            "f1_50": 2 * hits / (n_gt + n_dt),
            "sq": sq,
            "rq": rq,
            "pq": 2 * sums["quality_sum"] / (n_gt + n_dt),
            "n_gt": n_gt,
            "n_dt": n_dt,
            "n_hits_50": hits,
            "label_accuracy": sums["n_hits_right_label"] / hits,
        }


def matched_document(counts: MatchedCounts, *, class_aware: bool) -> Matched:
    """The run's own numbers as summary.json holds them: counts as integers, NaN as None."""
    metrics = matched_metrics(counts, np.ones((1, len(counts.per_image)), np.int32))
    if class_aware:
        del metrics["label_accuracy"]  # right by construction
    point: dict[str, Any] = {
        name: int(value[0]) if name.startswith("n_") else number(value[0])
        for name, value in metrics.items()
    }
    return Matched(**point)


def _macro(counts: MatchedCounts, samples: NDArray[np.int32]) -> Floats:
    """Mean over categories with truth of their summed IoU over their number of truths."""
    order = np.argsort(counts.cell_category, kind="stable")
    edges = np.flatnonzero(np.diff(counts.cell_category[order])) + 1
    groups = np.split(order, edges) if len(order) else []

    def sums(cells: Ints) -> tuple[Floats, Floats]:
        drawn = samples[:, counts.cell_image[cells]]
        n_gt = weighted_sums(drawn, counts.cell_n_gt[cells])
        return n_gt, weighted_sums(drawn, counts.cell_iou_sum[cells])

    means, present = np.zeros(len(samples)), np.zeros(len(samples))
    with core_threads() as pool:
        # Added in category order: order-independent, bit-identical.
        for n_gt, iou in pool.map(sums, groups):
            means += np.where(n_gt > 0, iou / np.where(n_gt > 0, n_gt, 1), 0.0)
            present += n_gt > 0
    with np.errstate(invalid="ignore"):
        result: Floats = means / present
    return result
