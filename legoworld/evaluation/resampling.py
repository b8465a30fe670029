"""Official metrics over bootstrap samples of images: re-accumulated, never matched again.

An image drawn twice stands twice in the ranking, its copies next to each other.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from legoworld.evaluation.accumulation import category_slices, mean_precision
from legoworld.evaluation.matching import FALSE_POSITIVE, IGNORED, TRUE_POSITIVE, MatchTable
from legoworld.evaluation.problem import Bools, Floats, Ints
from legoworld.evaluation.protocols import (
    AREA_NAMES,
    IOU_THRESHOLDS,
    RECALL_THRESHOLDS,
    DetectionProtocol,
    Metric,
)

#: Elements of one block of draws, to bound memory.
_BLOCK_ELEMENTS: Final = 1 << 21
#: Draws of one sparse product, to bound memory.
_MAX_BLOCK: Final = 512


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
    for a, area in enumerate(AREA_NAMES):
        metrics = [m for m in protocol.metrics if m.area == area]
        for k in np.unique(table.truth_category[table.n_truths[a] > 0]):
            wanted = [m for m in metrics if m.frequency in (None, group_of[k])]
            if not wanted:
                continue
            n_truths = _resampled_truths(table, a, int(k), columns)
            has = n_truths > 0
            for metric, values in _category(table, a, rows[k], columns, n_truths, wanted).items():
                sums[metric] += np.where(has, values, 0.0)
                defined[metric] += has
    with np.errstate(invalid="ignore"):
        return {name: sums[name] / np.where(defined[name], defined[name], np.nan) for name in sums}


def _resampled_truths(
    table: MatchTable, a: int, k: int, columns: NDArray[np.int32]
) -> NDArray[np.int64]:
    """(draws,) scored truth instances of a category."""
    cells = np.flatnonzero((table.truth_category == k) & (table.n_truths[a] > 0))
    found: NDArray[np.int64] = table.n_truths[a, cells] @ columns[table.truth_image[cells]]
    return found


def _category(
    table: MatchTable,
    a: int,
    rows: slice,
    columns: NDArray[np.int32],
    n_truths: NDArray[np.int64],
    metrics: list[Metric],
) -> dict[str, Floats]:
    """(draws,) of each metric for one category and area; meaningless where n_truths is 0."""
    state = table.state[a, :, rows]
    counted = (state != IGNORED).any(axis=0)
    state, image = state[:, counted], table.image[rows][counted]
    special = np.flatnonzero((state != FALSE_POSITIVE).any(axis=0))
    flags = state[:, special] == TRUE_POSITIVE, state[:, special] == FALSE_POSITIVE
    plain = _plain_between(image, special, columns.shape[0])
    rank = table.rank[rows][counted][special]
    values = {m.name: np.zeros(len(n_truths)) for m in metrics}
    block = min(_MAX_BLOCK, max(1, _BLOCK_ELEMENTS // (len(special) + 1)))
    for start in range(0, len(n_truths), block):
        draw = slice(start, start + block)
        weights = columns[:, draw]
        precision, recall = _block(
            flags,
            weights[image[special]],
            np.asarray(plain @ weights),
            n_truths[draw],
            rank,
            {m.max_rank for m in metrics if m.kind == "AR"},
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


def _block(
    flags: tuple[Bools, Bools],
    weights: NDArray[np.int32],
    plain: NDArray[np.int32],
    n_truths: NDArray[np.int64],
    rank: Ints,
    ranks: set[int | None],
) -> tuple[Floats, dict[int | None, Floats]]:
    """AP (T, n) and AR by rank (T, n) of n draws. weights, plain: (S, n)."""
    n = len(n_truths)
    plain_above = np.cumsum(plain, axis=0, dtype=np.int32)
    denominator = np.maximum(n_truths, 1)
    most = int((weights * flags[0].any(axis=0)[:, None]).sum(axis=0).max(initial=0))
    gained = np.searchsorted(
        RECALL_THRESHOLDS, np.arange(most + 1)[:, None] / denominator, side="right"
    ).astype(np.uint8)
    precision = np.zeros((len(IOU_THRESHOLDS), n))
    recall = {r: np.zeros((len(IOU_THRESHOLDS), n)) for r in ranks}
    for t, (true, false) in enumerate(zip(*flags, strict=True)):
        at = np.flatnonzero(true)
        n_false = np.cumsum(weights * false[:, None], axis=0, dtype=np.int32)[at] + plain_above[at]
        n_true = np.cumsum(weights[at], axis=0, dtype=np.int32)
        precision[t] = mean_precision(n_true, n_false, gained[n_true, np.arange(n)])
        for r in ranks:
            within = at if r is None else at[rank[at] < r]
            recall[r][t] = weights[within].sum(axis=0) / denominator
    return precision, recall
