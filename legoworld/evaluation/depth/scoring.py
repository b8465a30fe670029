"""Depth score of one image: aligned in disparity, then scored, each in one pass over its pixels.

Both passes take the valid ground truth in bands of rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import ShapeError
from legoworld.evaluation.depth.arrays import in_range
from legoworld.evaluation.depth.protocol import (
    DepthProtocol,
    ErrorSums,
    compute_metrics,
    error_sums,
)
from legoworld.evaluation.pixels.family import F64, Mask
from legoworld.evaluation.pixels.resampling import Sample, SampledPrediction
from legoworld.records.depth import Fit
from legoworld.records.pixels import Metrics

#: A spread below float32's resolution of the mean is rounding, not information.
_NO_SPREAD: Final = 2.0**-24
#: Approximate pixels per band: large enough for NumPy, small beside a 6048x4032 image.
_BAND_PX: Final = 1 << 18


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Centred second moments of n pairs: m_xx = sum (x - mean_x)^2, m_xy likewise."""

    n: int = 0
    mean_x: float = 0.0
    mean_y: float = 0.0
    m_xx: float = 0.0
    m_xy: float = 0.0


def compute_moments(x: F64, y: F64) -> Moments:
    """Moments of paired values, x and y: (n,) float64, finite. ShapeError otherwise."""
    if x.shape != y.shape or x.ndim != 1:
        raise ShapeError("paired values", found=f"{x.shape} and {y.shape}", expected="(n,) twice")
    if not len(x):
        return Moments()
    mean_x, mean_y = float(np.mean(x)), float(np.mean(y))
    centred_x = x - mean_x
    return Moments(
        n=len(x),
        mean_x=mean_x,
        mean_y=mean_y,
        m_xx=float(np.sum(centred_x * centred_x)),
        m_xy=float(np.sum(centred_x * (y - mean_y))),
    )


def merge_moments(a: Moments, b: Moments) -> Moments:
    """Moments of the union of two sets (Chan, Golub, LeVeque 1979, pairwise update)."""
    if not a.n or not b.n:
        return a if a.n else b
    n = a.n + b.n
    step_x, step_y = b.mean_x - a.mean_x, b.mean_y - a.mean_y
    weight = a.n * b.n / n
    return Moments(
        n=n,
        mean_x=a.mean_x + step_x * b.n / n,
        mean_y=a.mean_y + step_y * b.n / n,
        m_xx=a.m_xx + b.m_xx + step_x * step_x * weight,
        m_xy=a.m_xy + b.m_xy + step_x * step_y * weight,
    )


def solve(moments: Moments) -> Fit:
    """The least-squares line y = scale * x + shift; x predicted, y true disparity.

    "degenerate" where the best line is the constant mean_y: without spread in x, or where it rises
    by no more than rounding over the spread of x, as on a flat wall. Another non-positive scale is
    kept and flagged "inverted".
    """
    constant = Fit(scale=0.0, shift=moments.mean_y, status="degenerate")
    spread = math.sqrt(moments.m_xx / moments.n) if moments.n else 0.0
    if spread <= _NO_SPREAD * abs(moments.mean_x):
        return constant
    scale = moments.m_xy / moments.m_xx
    if abs(scale) * spread <= _NO_SPREAD * abs(moments.mean_y):
        return constant
    return Fit(
        scale=scale,
        shift=moments.mean_y - scale * moments.mean_x,
        status="ok" if scale > 0 else "inverted",
    )


def aligned_z(disparity: F64, fit: Fit, min_disparity: float) -> tuple[F64, Mask]:
    """Aligned depth in the ground truth's unit, and where the disparity was clamped from below.

    disparity: (n,) predicted; min_disparity: 1 / max(valid truth), so that no aligned depth exceeds
    the deepest ground truth.
    """
    aligned = fit.scale * disparity + fit.shift
    clamped = aligned < min_disparity
    return 1.0 / np.maximum(aligned, min_disparity), clamped


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Pixels of valid truth, and of those with a prediction, clamped, outside the view."""

    truth: int = 0
    predicted: int = 0
    clamped: int = 0
    outside: int = 0


@dataclass(frozen=True, kw_only=True)
class ImageScore:
    """fit, metrics and constant are None if there are too few pixels to score.

    constant: the metrics of the best constant disparity (zero information), fitted and scored on
    the pixels each policy scores. deepest_z_m: the largest valid ground truth.
    """

    counts: Counts
    deepest_z_m: float
    fit: Fit | None = None
    metrics: Metrics | None = None
    constant: Metrics | None = None


@dataclass(frozen=True, kw_only=True)
class _FirstPass:
    fit: Moments
    whole: Moments
    deepest_z_m: float
    counts: Counts


def score_image(truth_z_m: NDArray[Any], sample: Sample, protocol: DepthProtocol) -> ImageScore:
    """Align a prediction to the ground truth and score it under every hole policy.

    truth_z_m: (H, W), valid where finite and positive; sample: the prediction at its pixels.
    """
    first = _first_pass(truth_z_m, sample)
    if min(first.counts.truth, first.counts.predicted) < protocol.min_valid_px:
        return ImageScore(counts=first.counts, deepest_z_m=first.deepest_z_m)
    fit = solve(first.fit)
    floor = 1.0 / first.deepest_z_m
    base = protocol.delta_base
    seen = holes = constant_seen = constant_whole = ErrorSums()
    clamped = 0
    for true_z_m, sampled in _bands(truth_z_m, sample):
        on, off = sampled.predicted, ~sampled.predicted
        z_m, low = aligned_z(sampled.values[on], fit, floor)
        clamped += int(np.count_nonzero(low))
        seen += error_sums(z_m, true_z_m[on], base)
        holes += error_sums(np.full(int(off.sum()), first.deepest_z_m), true_z_m[off], base)
        constant_seen += _constant_sums(first.fit, true_z_m[on], base)
        constant_whole += _constant_sums(first.whole, true_z_m, base)
    return ImageScore(
        counts=replace(first.counts, clamped=clamped),
        deepest_z_m=first.deepest_z_m,
        fit=fit,
        metrics=compute_metrics(seen, holes, protocol),
        constant=_constant_metrics(constant_seen, constant_whole, protocol),
    )


def valid_truth(z_m: NDArray[Any]) -> Mask:
    """Mask of finite and positive values, of z_m's shape."""
    return in_range(z_m, signed=False)


def _first_pass(truth_z_m: NDArray[Any], sample: Sample) -> _FirstPass:
    fit = whole = Moments()
    deepest = 0.0
    outside = 0
    for true_z_m, sampled in _bands(truth_z_m, sample):
        if not len(true_z_m):
            continue
        disparity = 1.0 / true_z_m
        on = sampled.predicted
        fit = merge_moments(fit, compute_moments(sampled.values[on], disparity[on]))
        whole = merge_moments(whole, compute_moments(disparity, disparity))
        deepest = max(deepest, float(true_z_m.max()))
        outside += int(np.count_nonzero(sampled.outside))
    counts = Counts(truth=whole.n, predicted=fit.n, outside=outside)
    return _FirstPass(fit=fit, whole=whole, deepest_z_m=deepest, counts=counts)


def _bands(truth_z_m: NDArray[Any], sample: Sample) -> Iterator[tuple[F64, SampledPrediction]]:
    """Valid truth (n,) float64 and the prediction there, in row order."""
    height, width = truth_z_m.shape
    step = max(1, _BAND_PX // width)
    for start in range(0, height, step):
        band = truth_z_m[start : start + step]
        rows, cols = np.nonzero(valid_truth(band))
        yield band[rows, cols].astype(np.float64), sample(rows + start, cols)


def _constant_sums(moments: Moments, true_z_m: F64, delta_base: float) -> ErrorSums:
    """Errors of the least-squares constant: the mean disparity, by the moments' second value."""
    return error_sums(np.full(len(true_z_m), 1.0 / moments.mean_y), true_z_m, delta_base)


def _constant_metrics(seen: ErrorSums, whole: ErrorSums, protocol: DepthProtocol) -> Metrics:
    """A constant has no holes: on the predicted pixels under exclude, on all of them otherwise."""
    on_seen = compute_metrics(seen, ErrorSums(), protocol)
    on_whole = compute_metrics(whole, ErrorSums(), protocol)
    return {
        metric: {
            policy: (on_seen if policy == "exclude" else on_whole)[metric][policy]
            for policy in policies
        }
        for metric, policies in on_seen.items()
    }
