"""Official metrics over bootstrap samples of images: re-accumulated, never matched again.

A sample is a data set of its own: an image drawn c times is c images with as many copies of its
predictions and truth, which stand where the image stood in the order of ids, one after the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from legoworld.errors import ShapeError
from legoworld.evaluation.detection.grid import Grid
from legoworld.evaluation.detection.matching.outcomes import MatchTable
from legoworld.evaluation.detection.problem import Floats
from legoworld.evaluation.detection.protocols import DetectionProtocol, Metric
from legoworld.evaluation.detection.ranking.compiled_accumulation import (
    in_lanes,
    rank_category,
    resample,
)
from legoworld.workers.processors import core_threads

Counts = NDArray[np.int32]


def resampled_metrics(
    table: MatchTable,
    protocol: DetectionProtocol,
    counts: Counts,
    frequencies: NDArray[np.str_] | None = None,
) -> dict[str, Floats]:
    """Every official metric in every bootstrap sample: (draws,), NaN where it is undefined.

    counts: (draws, images) how often each image is in each sample (bootstrap.resample_counts).
    """
    sums = {m.name: np.zeros(len(counts)) for m in protocol.metrics}
    defined = {m.name: np.zeros(len(counts)) for m in protocol.metrics}
    _check_size(table, counts)
    laned, by_image = in_lanes(counts), np.ascontiguousarray(counts.T)
    rows = table.category_slices
    group_of = [""] * len(rows) if frequencies is None else frequencies.tolist()
    grid = protocol.grid
    with core_threads() as pool:
        for a, area in enumerate(grid.areas):
            truths = _truths_by_image(table, a) @ by_image
            metrics = [m for m in protocol.metrics if m.area == area]
            jobs = [
                (int(k), [m for m in metrics if m.frequency in (None, group_of[k])])
                for k in np.unique(table.truth_category[table.n_truths[a] > 0])
            ]
            by_category = pool.map(
                lambda job, a=a, n=truths: _category(
                    table, a, rows[job[0]], laned, n[job[0]], job[1], grid
                ),
                jobs,
            )
            # Added in category order: order-independent, bit-identical.
            for (k, _), values in zip(jobs, by_category, strict=True):
                has = truths[k] > 0
                for metric, value in values.items():
                    sums[metric] += np.where(has, value, 0.0)
                    defined[metric] += has
    with np.errstate(invalid="ignore"):
        return {name: sums[name] / np.where(defined[name], defined[name], np.nan) for name in sums}


def single_image_metrics(
    table: MatchTable, protocol: DetectionProtocol, frequencies: NDArray[np.str_]
) -> set[str]:
    """Metrics whose truth lies in fewer than two images: resampling cannot show their spread.

    frequencies: (K,) LVIS's r, c, f.
    """
    lone = set()
    for metric in protocol.metrics:
        cells = table.n_truths[protocol.grid.areas.index(metric.area)] > 0
        if metric.frequency is not None:
            cells &= frequencies[table.truth_category] == metric.frequency
        if len(np.unique(table.truth_image[cells])) < 2:
            lone.add(metric.name)
    return lone


def _check_size(table: MatchTable, counts: Counts) -> None:
    """ShapeError where a sample could hold more detections than are counted in 32 bits."""
    often = int(counts.max(initial=0))
    most = len(table.image) * often
    if counts.shape[1] != len(table.image_ids) or often >= 1 << 16 or most >= 1 << 31:
        raise ShapeError(
            "a bootstrap sample cannot be accumulated",
            found=f"{counts.shape[1]} images drawn, one up to {often} times, up to {most} "
            "predictions in a sample",
            expected=f"{len(table.image_ids)} images, each below 2**16 times, and below 2**31 "
            "predictions",
        )


def _truths_by_image(table: MatchTable, a: int) -> sparse.csr_matrix:
    """(categories, images) scored truth instances."""
    shape = len(table.category_ids), len(table.image_ids)
    cells = table.truth_category, table.truth_image
    return sparse.csr_matrix((table.n_truths[a].astype(np.int32), cells), shape=shape)


def _category(
    table: MatchTable,
    a: int,
    rows: slice,
    laned: NDArray[np.uint16],
    n_truths: Counts,
    metrics: list[Metric],
    grid: Grid,
) -> dict[str, Floats]:
    """(draws,) of each metric for one category and area; meaningless where n_truths is 0."""
    ranking = rank_category(
        table.state[a, :, rows], table.image[rows], table.score[rows], table.rank[rows]
    )
    ranks = list(dict.fromkeys(m.max_rank for m in metrics if m.kind == "AR"))
    some = np.maximum(n_truths, 1)
    precision, recalls = resample(ranking, laned, some, ranks)
    recall = {rank: recalls[r] / some for r, rank in enumerate(ranks)}
    values = {}
    for m in metrics:
        which = grid.thresholds(m.iou)
        values[m.name] = average_thresholds(
            (precision if m.kind == "AP" else recall[m.max_rank])[which]
        )
    return values


def average_thresholds(values: Floats) -> Floats:
    """(n,) mean over thresholds of (T, n), added one after the other whatever n is."""
    mean: Floats = np.add.accumulate(values, axis=0)[-1] / len(values)
    return mean
