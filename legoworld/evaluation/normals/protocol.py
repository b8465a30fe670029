"""The protocol of normals: its card, and angular errors as sums that pool and as metrics."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import Card
from legoworld.evaluation.normals.arrays import SIGNS, unit_vectors, valid_normals
from legoworld.evaluation.pixels.family import F64, PixelMetric, PixelProtocol, pixel_protocol
from legoworld.evaluation.pixels.resampling import Sample
from legoworld.records.normals import AngularErrors
from legoworld.records.pixels import Metrics

THRESHOLDS_DEG: Final = (5.0, 7.5, 11.25, 22.5, 30.0)
SHARES: Final = ("below_5", "below_7_5", "below_11_25", "below_22_5", "below_30")
ANGLES: Final = ("mean_deg", "median_deg", "rmse_deg")
#: Of a pixel without a prediction: an error of 90 degrees, left out, or in no share.
ERROR_90, EXCLUDE, FAILS = HOLE_POLICIES = ("error_90", "exclude", "fails")
HOLE_DEG: Final = 90.0
#: Of the counts of errors, which say where the pooled median lies.
RESOLUTION_DEG: Final = 0.01

METRICS: Final = (
    *(
        PixelMetric(
            name=name,
            better="lower",
            policies=(ERROR_90, EXCLUDE),
            headline=(ERROR_90, EXCLUDE) if name == ANGLES[0] else (),
        )
        for name in ANGLES
    ),
    *(
        PixelMetric(
            name=name,
            better="higher",
            policies=(FAILS, EXCLUDE),
            headline=(FAILS,) if name == "below_11_25" else (),
            detail=name in ("below_5", "below_7_5"),
        )
        for name in SHARES
    ),
)

_FIXED: Final[dict[str, Any]] = {
    "export.signs_accepted": list(SIGNS),
    "scoring.protocol": "angular_error",
    "scoring.primary_metric": ANGLES[0],
    "scoring.metrics": [*ANGLES, *SHARES],
    "scoring.thresholds_deg": list(THRESHOLDS_DEG),
    "scoring.aggregate": "pooled_pixels_and_unweighted_image_mean",
    "scoring.pooled_median": "exact",
    "scoring.resample": "bilinear_with_mask",
    "scoring.valid_truth": "length_above_half",
    "scoring.failed_image_mean_deg": HOLE_DEG,
    "scoring.bootstrap_unit": "image",
    "holes.policies": list(HOLE_POLICIES),
    "holes.primary": ERROR_90,
    "holes.error_90": HOLE_DEG,
    "holes.fails": "in_no_share",
}
#: Declared choices that are copied from the card into the summary.
_DECLARED: Final = (
    "scoring.aggregate",
    "scoring.pooled_median",
    "scoring.resolution",
    "scoring.resample",
    "scoring.valid_truth",
    "holes.policies",
    "holes.primary",
)
_BAND_PX: Final = 1 << 18
PER_DEGREE: Final = round(1.0 / RESOLUTION_DEG)


def normals_protocol(card: Card) -> PixelProtocol:
    """A card's protocol; InstallationError if a fixed value differs from the code's."""
    return pixel_protocol(card, fixed=_FIXED, declared=_DECLARED)


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
    n_bins = np.flatnonzero(counts).max(initial=-1) + 1
    return AngularErrors(
        n=len(errors_deg),
        sum_deg=float(errors_deg.sum()),
        sum_deg2=float(np.square(errors_deg).sum()),
        below=tuple(int(np.count_nonzero(errors_deg < limit)) for limit in THRESHOLDS_DEG),
        counts=tuple(_pack_zeros(counts[:n_bins].tolist())),
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
