"""Angular errors of an image, as sums that pool over images, and as metrics."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.normals.arrays import unit_vectors, valid_normals
from legoworld.evaluation.normals.protocol import (
    ANGLES,
    ERROR_90,
    EXCLUDE,
    FAILS,
    HOLE_DEG,
    RESOLUTION_DEG,
    SHARES,
    THRESHOLDS_DEG,
)
from legoworld.evaluation.pixels.family import F64
from legoworld.evaluation.pixels.resampling import Sample
from legoworld.records.normals import AngularErrors
from legoworld.records.pixels import Metrics

_BAND_PX: Final = 1 << 18
PER_DEGREE: Final = round(1.0 / RESOLUTION_DEG)


def angular_errors(truth: NDArray[Any], sample: Sample, n_valid: int) -> F64:
    """(n,) errors in degrees where truth and prediction are known: acos of the clamped product.

    truth: (H, W, 3), towards the camera as samples are; n_valid: of its pixels. Eight bytes for
    each valid pixel stay in memory, bands of rows besides.
    """
    errors = np.empty(n_valid)
    height, width = truth.shape[:2]
    step, end = max(1, _BAND_PX // width), 0
    for start in range(0, height, step):
        band = truth[start : start + step]
        rows, cols = np.nonzero(valid_normals(band))
        sampled = sample(rows + start, cols)
        on = sampled.predicted
        true = unit_vectors(band[rows[on], cols[on]])
        cosines = np.einsum("ij,ij->i", true, unit_vectors(sampled.values[on]))
        errors[end : end + len(cosines)] = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
        end += len(cosines)
    return errors[:end]


def sum_errors(errors_deg: F64) -> AngularErrors:
    """The sums of (n,) errors."""
    counts = np.zeros(180 * PER_DEGREE + 1, np.int64)
    for start in range(0, len(errors_deg), _BAND_PX):
        part = bin_errors(errors_deg[start : start + _BAND_PX])
        counts += np.bincount(part, minlength=len(counts))
    return AngularErrors(
        n=len(errors_deg),
        sum_deg=float(errors_deg.sum()),
        sum_deg2=float(np.square(errors_deg).sum()),
        below=tuple(int(np.count_nonzero(errors_deg < limit)) for limit in THRESHOLDS_DEG),
        counts=tuple(_pack_zeros(np.trim_zeros(counts, "b").tolist())),
    )


def bin_errors(errors_deg: F64) -> NDArray[np.int64]:
    """(n,) errors rounded to hundredths of a degree."""
    bins: NDArray[np.int64] = np.rint(errors_deg * PER_DEGREE).astype(np.int64)
    return bins


def image_metrics(errors_deg: F64, sums: AngularErrors, holes: int) -> Metrics:
    """Every metric under every policy that defines it; the median is exact. errors_deg: (n,)."""
    medians = {EXCLUDE: float(np.median(errors_deg))}
    filled = np.concatenate([errors_deg, np.full(holes, HOLE_DEG)]) if holes else errors_deg
    medians[ERROR_90] = float(np.median(filled)) if holes else medians[EXCLUDE]
    return angular_metrics(sums.n, sums.sum_deg, sums.sum_deg2, sums.below, holes, medians)


def angular_metrics(
    n: int,
    sum_deg: float,
    sum_deg2: float,
    below: Sequence[int],
    holes: int,
    medians: Mapping[str, float],
) -> Metrics:
    """Every metric under every policy; medians: of the errors, by policy."""
    every = n + holes
    mean, median, rmse = ANGLES
    found: Metrics = {
        mean: {ERROR_90: (sum_deg + HOLE_DEG * holes) / every, EXCLUDE: sum_deg / n},
        median: {ERROR_90: medians[ERROR_90], EXCLUDE: medians[EXCLUDE]},
        rmse: {
            ERROR_90: math.sqrt((sum_deg2 + HOLE_DEG * HOLE_DEG * holes) / every),
            EXCLUDE: math.sqrt(sum_deg2 / n),
        },
    }
    for name, hits in zip(SHARES, below, strict=True):
        found[name] = {FAILS: hits / every, EXCLUDE: hits / n}
    return found


def _pack_zeros(counts: Sequence[int]) -> Iterator[int]:
    """Counts with each run of zeros as its negative length."""
    for is_zero, run in groupby(counts, key=lambda count: count == 0):
        values = list(run)
        if is_zero:
            yield -len(values)
        else:
            yield from values
