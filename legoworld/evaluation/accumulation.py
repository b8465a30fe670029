"""Precision and recall from a match table, as pycocotools and lvis accumulate them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.matching import FALSE_POSITIVE, TRUE_POSITIVE, MatchTable
from legoworld.evaluation.problem import Floats, Ints
from legoworld.evaluation.protocols import (
    AREA_NAMES,
    IOU_THRESHOLDS,
    RECALL_THRESHOLDS,
    DetectionProtocol,
    Metric,
)


@dataclass(frozen=True, kw_only=True)
class Curves:
    """precision: (T, R, K, A) at the recall thresholds; recall: (T, K, A, M) reached.

    M goes with `ranks`: how many detections per image and category take part (None: all). -1
    where a category has no scored truth, as both evaluators have it.
    """

    precision: Floats
    recall: Floats
    ranks: tuple[int | None, ...]


def category_slices(table: MatchTable) -> list[slice]:
    """Where each category's detections lie in the table."""
    edges = np.searchsorted(table.category, np.arange(len(table.category_ids) + 1))
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]


def truths_per_category(table: MatchTable) -> Ints:
    """(A, K) scored truth instances."""
    n = len(table.category_ids)
    return np.stack(
        [np.bincount(table.truth_category, weights=row, minlength=n) for row in table.n_truths]
    ).astype(np.int64)


def ranks_of(protocol: DetectionProtocol) -> tuple[int | None, ...]:
    """The distinct maxDets that a protocol's metrics ask for."""
    return tuple(dict.fromkeys(m.max_rank for m in protocol.metrics if m.kind == "AR"))


def accumulate(table: MatchTable, protocol: DetectionProtocol) -> Curves:
    """The curves of every category and area."""
    ranks = ranks_of(protocol)
    shape = len(IOU_THRESHOLDS), len(table.category_ids), len(AREA_NAMES)
    precision = np.full((shape[0], len(RECALL_THRESHOLDS), *shape[1:]), -1.0)
    recall = np.full((*shape, len(ranks)), -1.0)
    n_truths = truths_per_category(table)
    for k, rows in enumerate(category_slices(table)):
        for a in range(len(AREA_NAMES)):
            if not n_truths[a, k]:
                continue
            true = table.state[a, :, rows] == TRUE_POSITIVE
            false = table.state[a, :, rows] == FALSE_POSITIVE
            precision[:, :, k, a] = _precision_at_recalls(true, false, int(n_truths[a, k]))
            for m, rank in enumerate(ranks):
                within = true if rank is None else true[:, table.rank[rows] < rank]
                recall[:, k, a, m] = within.sum(axis=1) / n_truths[a, k]
    return Curves(precision=precision, recall=recall, ranks=ranks)


def metric_value(
    metric: Metric, curves: Curves, frequencies: NDArray[np.str_] | None = None
) -> float:
    """One official number: the mean of the entries that are defined, -1 when none is.

    frequencies: (K,) LVIS's r, c, f; needed for the metrics of a frequency group.
    """
    a = AREA_NAMES.index(metric.area)
    thresholds = slice(None) if metric.iou is None else metric.iou == IOU_THRESHOLDS
    if metric.kind == "AP":
        values = curves.precision[thresholds, :, :, a]
    else:
        values = curves.recall[thresholds, :, a, curves.ranks.index(metric.max_rank)]
    if metric.frequency is not None:
        assert frequencies is not None
        values = values[:, :, frequencies == metric.frequency]
    defined = values[values > -1]
    return float(defined.mean()) if len(defined) else -1.0


def gained_thresholds(n_truths: int) -> NDArray[np.uint8]:
    """How many recall thresholds are reached with m true positives: (n_truths + 1,).

    In floating point as the evaluators compare them. Threshold 0 is reached with none.
    """
    return np.searchsorted(
        RECALL_THRESHOLDS, np.arange(n_truths + 1) / n_truths, side="right"
    ).astype(np.uint8)


def mean_precision(
    true: NDArray[np.signedinteger[Any]],
    false: NDArray[np.signedinteger[Any]],
    gained: NDArray[np.uint8],
) -> Floats:
    """101-point average precision of n curves, each given at S places down its ranking.

    true, false: (S, n) true and false positives up to each place, which must include every place
    where `true` grows; gained: (S, n) recall thresholds reached there. Precision between two
    places only falls, so nothing else is needed. Returns (n,); 0 where S is 0.
    """
    if not len(true):
        return np.zeros(true.shape[1])
    total = true + false
    precision = np.divide(true, total, out=np.zeros(total.shape), where=total > 0)
    envelope = np.maximum.accumulate(precision[::-1], axis=0)[::-1]
    steps = np.diff(gained, axis=0, prepend=np.zeros((1, gained.shape[1]), np.uint8))
    values: Floats = np.add.reduce(envelope * steps, axis=0) / len(RECALL_THRESHOLDS)
    return values


def segments(sorted_values: Floats) -> Iterator[slice]:
    """Runs of equal values."""
    edges = np.flatnonzero(np.diff(sorted_values)) + 1
    bounds = [0, *edges.tolist(), len(sorted_values)]
    for start, stop in itertools.pairwise(bounds):
        if stop > start:
            yield slice(start, stop)


def _precision_at_recalls(
    true: NDArray[np.bool_], false: NDArray[np.bool_], n_truths: int
) -> Floats:
    """(T, R) interpolated precision of one category and area. true, false: (T, D)."""
    values = np.zeros((len(true), len(RECALL_THRESHOLDS)))
    if not true.shape[1]:
        return values
    n_true, n_false = np.cumsum(true, axis=1), np.cumsum(false, axis=1)
    precision = n_true / (n_true + n_false + np.spacing(1))
    envelope = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
    for t, recall in enumerate(n_true / n_truths):
        places = np.searchsorted(recall, RECALL_THRESHOLDS, side="left")
        reached = places < len(recall)
        values[t, reached] = envelope[t, places[reached]]
    return values
