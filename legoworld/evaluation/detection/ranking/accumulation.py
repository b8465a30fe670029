"""Precision and recall from a match table, as pycocotools and lvis accumulate them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.grid import N_THRESHOLDS, RECALL_THRESHOLDS, Grid
from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    TRUE_POSITIVE,
    MatchTable,
)
from legoworld.evaluation.detection.problem import Floats
from legoworld.evaluation.detection.protocols import DetectionProtocol, Metric

Counts = NDArray[np.signedinteger[Any]]


@dataclass(frozen=True, kw_only=True)
class Curves:
    """precision: (T, R, K, A) at the recall thresholds; recall: (T, K, A, M) reached.

    M goes with `ranks`: how many detections per image and category take part (None: all). -1
    where a category has no scored truth, as both evaluators have it.
    """

    precision: Floats
    recall: Floats
    ranks: tuple[int | None, ...]
    grid: Grid


def distinct_max_dets(protocol: DetectionProtocol) -> tuple[int | None, ...]:
    """The distinct maxDets of a protocol's metrics."""
    return tuple(dict.fromkeys(m.max_rank for m in protocol.metrics if m.kind == "AR"))


def accumulate(table: MatchTable, protocol: DetectionProtocol) -> Curves:
    """The curves of every category and area."""
    ranks, grid = distinct_max_dets(protocol), protocol.grid
    shape = N_THRESHOLDS, len(table.category_ids), len(grid.areas)
    precision = np.full((shape[0], len(RECALL_THRESHOLDS), *shape[1:]), -1.0)
    recall = np.full((*shape, len(ranks)), -1.0)
    n_truths = table.truths_per_category
    for k, rows in enumerate(table.category_slices):
        for a in range(len(grid.areas)):
            if not n_truths[a, k]:
                continue
            true = table.state[a, :, rows] == TRUE_POSITIVE
            false = table.state[a, :, rows] == FALSE_POSITIVE
            precision[:, :, k, a] = precision_at_recalls(true, false, int(n_truths[a, k]))
            for m, rank in enumerate(ranks):
                within = true if rank is None else true[:, table.rank[rows] < rank]
                recall[:, k, a, m] = within.sum(axis=1) / n_truths[a, k]
    return Curves(precision=precision, recall=recall, ranks=ranks, grid=grid)


def metric_value(
    metric: Metric, curves: Curves, frequencies: NDArray[np.str_] | None = None
) -> float:
    """One official number: the mean of the entries that are defined, -1 when none is.

    frequencies: (K,) LVIS's r, c, f; needed for the metrics of a frequency group.
    """
    a = curves.grid.areas.index(metric.area)
    thresholds = curves.grid.thresholds(metric.iou)
    if metric.kind == "AP":
        values = curves.precision[thresholds, :, :, a]
    else:
        values = curves.recall[thresholds, :, a, curves.ranks.index(metric.max_rank)]
    if metric.frequency is not None:
        assert frequencies is not None
        values = values[:, :, frequencies == metric.frequency]
    defined = values[values > -1]
    return float(defined.mean()) if len(defined) else -1.0


def recall_steps(n_truths: int) -> NDArray[np.uint8]:
    """How many recall thresholds each true positive reaches first: (n_truths,), 101 in all.

    In floating point as the evaluators compare them. Threshold 0, which is reached with none, is
    counted with the first.
    """
    gained = np.searchsorted(RECALL_THRESHOLDS, np.arange(1, n_truths + 1) / n_truths, side="right")
    return np.diff(gained, prepend=0).astype(np.uint8)


def mean_precision(n_true: Counts, n_all: Counts, steps: NDArray[np.uint8]) -> Floats:
    """101-point average precision of n curves, each given at S places down its ranking.

    n_true, n_all: (n, S) true positives, and detections that count, up to each place; the places
    must include every one where n_true grows. steps: (n, S) recall thresholds reached there
    first; (S,) where they are the same for all curves, as is then n_true. Precision between two
    places only falls, so nothing else is needed. Returns (n,); 0 where S is 0. Terms are added
    from the top of the ranking down, so that a curve has the same bits alone and in any block.
    """
    if not n_all.shape[1]:
        return np.zeros(len(n_all))
    envelope = n_true / np.maximum(n_all, 1)
    backwards = envelope[:, ::-1]
    np.maximum.accumulate(backwards, axis=1, out=backwards)
    if steps.ndim == 1:
        envelope, steps = envelope[:, steps > 0], steps[steps > 0]
    envelope *= steps
    np.add.accumulate(envelope, axis=1, out=envelope)
    values: Floats = envelope[:, -1] / len(RECALL_THRESHOLDS)
    return values


def precision_at_recalls(
    true: NDArray[np.bool_], false: NDArray[np.bool_], n_truths: int
) -> Floats:
    """(T, R) interpolated precision of one category and area. true, false: (T, D), best first."""
    values = np.zeros((len(true), len(RECALL_THRESHOLDS)))
    for t, hits in enumerate(map(np.flatnonzero, true)):
        # Recall and the envelope change at true positives alone.
        n_true, n_false = np.arange(1, len(hits) + 1), np.cumsum(false[t])[hits]
        envelope = np.maximum.accumulate((n_true / (n_true + n_false + np.spacing(1)))[::-1])[::-1]
        places = np.searchsorted(n_true / n_truths, RECALL_THRESHOLDS, side="left")
        reached = places < len(hits)
        values[t, reached] = envelope[places[reached]]
    return values
