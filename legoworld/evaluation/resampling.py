"""Official metrics over bootstrap samples of images: re-accumulated, never matched again.

An image drawn twice stands twice in the ranking, its copies next to each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from legoworld.evaluation.accumulation import category_slices, mean_precision
from legoworld.evaluation.category_threads import category_threads
from legoworld.evaluation.matching import FALSE_POSITIVE, IGNORED, TRUE_POSITIVE, MatchTable
from legoworld.evaluation.problem import Floats, Ints
from legoworld.evaluation.protocols import (
    AREA_NAMES,
    IOU_THRESHOLDS,
    RECALL_THRESHOLDS,
    DetectionProtocol,
    Metric,
)

#: Elements of what is accumulated at a time, so that it stays in a core's cache.
_PIECE_ELEMENTS: Final = 1 << 15
#: Elements of the image counts that are gathered at a time, to bound memory.
_GATHERED_ELEMENTS: Final = 1 << 22

Counts = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True)
class _Ranked:
    """One category's detections at one area that are not a false positive at every threshold.

    true, skipped: for each threshold, positions of true positives and of ignored detections;
    image, rank: (S,) as in MatchTable; plain: (S, images) false positives at every threshold of
    each image between a detection and the last.
    """

    true: list[Ints]
    skipped: list[Ints]
    image: Ints
    rank: Ints
    plain: sparse.csr_matrix


def resampled_metrics(
    table: MatchTable,
    protocol: DetectionProtocol,
    counts: NDArray[np.int32],
    frequencies: NDArray[np.str_] | None = None,
) -> dict[str, Floats]:
    """Every official metric in every bootstrap sample: (draws,), NaN where it is undefined.

    counts: (draws, images) how often each image is in each sample (bootstrap.resample_counts).
    """
    draws = len(counts)
    columns = np.ascontiguousarray(counts.T)
    sums = {m.name: np.zeros(draws) for m in protocol.metrics}
    defined = {m.name: np.zeros(draws) for m in protocol.metrics}
    rows = category_slices(table)
    group_of = [""] * len(rows) if frequencies is None else frequencies.tolist()
    with category_threads() as pool:
        for a, area in enumerate(AREA_NAMES):
            truths = _truths_by_image(table, a) @ columns
            jobs = [
                (int(k), [m for m in protocol.metrics if m.area == area and _is_in(m, group_of[k])])
                for k in np.unique(table.truth_category[table.n_truths[a] > 0])
            ]
            found = pool.map(
                lambda job, a=a, n=truths: _category(
                    _ranked(table, a, rows[job[0]]), columns, n[job[0]], job[1]
                ),
                jobs,
            )
            # Added in the order of the categories, whoever is ready first: always the same bits.
            for (k, _), values in zip(jobs, found, strict=True):
                has = truths[k] > 0
                for metric, value in values.items():
                    sums[metric] += np.where(has, value, 0.0)
                    defined[metric] += has
    with np.errstate(invalid="ignore"):
        return {name: sums[name] / np.where(defined[name], defined[name], np.nan) for name in sums}


def _is_in(metric: Metric, frequency: str) -> bool:
    return metric.frequency in (None, frequency)


def _truths_by_image(table: MatchTable, a: int) -> sparse.csr_matrix:
    """(categories, images) scored truth instances."""
    shape = len(table.category_ids), len(table.image_ids)
    cells = table.truth_category, table.truth_image
    return sparse.csr_matrix((table.n_truths[a].astype(np.int32), cells), shape=shape)


def _ranked(table: MatchTable, a: int, rows: slice) -> _Ranked:
    state = table.state[a, :, rows]
    counted = np.flatnonzero((state != IGNORED).any(axis=0))
    state, image = state[:, counted], table.image[rows][counted]
    special = np.flatnonzero((state != FALSE_POSITIVE).any(axis=0))
    state = state[:, special]
    return _Ranked(
        true=[np.flatnonzero(found) for found in state == TRUE_POSITIVE],
        skipped=[np.flatnonzero(found) for found in state == IGNORED],
        image=image[special],
        rank=table.rank[rows][counted][special],
        plain=_plain_between(image, special, len(table.image_ids)),
    )


def _category(
    ranked: _Ranked, columns: Counts, n_truths: Counts, metrics: list[Metric]
) -> dict[str, Floats]:
    """(draws,) of each metric for one category and area; meaningless where n_truths is 0."""
    values = {m.name: np.zeros(len(n_truths)) for m in metrics}
    ranks = {m.max_rank for m in metrics if m.kind == "AR"}
    piece = max(1, _PIECE_ELEMENTS // (len(ranked.image) + 1))
    most = max(piece, _GATHERED_ELEMENTS // (len(ranked.image) + 1))
    for start in range(0, len(n_truths), most):
        some = columns[:, start : start + most]
        weights, plain = some[ranked.image], np.asarray(ranked.plain @ some)
        for at in range(0, weights.shape[1], piece):
            part = slice(at, at + piece)
            draw = slice(start + at, min(start + at + piece, start + weights.shape[1]))
            precision, recall = _piece(
                ranked,
                np.ascontiguousarray(weights[:, part].T),
                np.ascontiguousarray(plain[:, part].T),
                np.maximum(n_truths[draw], 1),
                ranks,
            )
            for m in metrics:
                which = slice(None) if m.iou is None else m.iou == IOU_THRESHOLDS
                chosen = precision if m.kind == "AP" else recall[m.max_rank]
                values[m.name][draw] = chosen[which].mean(axis=0)
    return values


def _plain_between(image: Ints, special: Ints, n_images: int) -> sparse.csr_matrix:
    """(S, images) plain false positives of each image between a special detection and the last."""
    place = np.arange(len(image))
    plain = np.ones(len(image), bool)
    plain[special] = False
    segment = np.searchsorted(special, place[plain])
    before = segment < len(special)
    ones = np.ones(int(before.sum()), np.int32)
    return sparse.csr_matrix(
        (ones, (segment[before], image[plain][before])), shape=(len(special), n_images)
    )


def _piece(
    ranked: _Ranked, weights: Counts, plain: Counts, n_truths: Counts, ranks: set[int | None]
) -> tuple[Floats, dict[int | None, Floats]]:
    """AP (T, n) and AR by rank (T, n) of n draws. weights, plain: (n, S); n_truths: (n,), > 0."""
    n = len(n_truths)
    above = np.cumsum(weights + plain, axis=1, dtype=np.int32)
    precision = np.zeros((len(IOU_THRESHOLDS), n))
    recall = {r: np.zeros((len(IOU_THRESHOLDS), n)) for r in ranks}
    gained, width = _gained(n_truths, weights)
    first = (np.arange(n) * width)[:, None]
    for t, (at, skipped) in enumerate(zip(ranked.true, ranked.skipped, strict=True)):
        drawn = weights.take(at, axis=1)
        n_true = np.cumsum(drawn, axis=1, dtype=np.intp)
        n_all = above.take(at, axis=1)
        if len(skipped):
            out = np.zeros((n, len(skipped) + 1), np.int32)
            np.cumsum(weights.take(skipped, axis=1), axis=1, out=out[:, 1:])
            n_all -= out.take(np.searchsorted(skipped, at), axis=1)
        steps = gained.take(n_true + first)
        steps[:, 1:] -= steps[:, :-1].copy()
        precision[t] = mean_precision(n_true, n_all, steps)
        for r in ranks:
            within = drawn if r is None else drawn[:, ranked.rank[at] < r]
            recall[r][t] = np.add.reduce(within, axis=1) / n_truths
    return precision, recall


def _gained(n_truths: Counts, weights: Counts) -> tuple[NDArray[np.uint8], int]:
    """Recall thresholds reached in each draw with 0, 1, ... true positives, and how many of these.

    In floating point as the evaluators compare them: m / n >= threshold.
    """
    most = int(np.add.reduce(weights, axis=1).max(initial=0))
    different, which = np.unique(n_truths, return_inverse=True)
    shares = np.arange(most + 1) / different[:, None]
    found = np.searchsorted(RECALL_THRESHOLDS, shares, side="right").astype(np.uint8)
    return found[which].ravel(), most + 1
