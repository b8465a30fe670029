"""Scale and shift in disparity by least squares, in one pass over the pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from legoworld.errors import ShapeError
from legoworld.evaluation.pixels.family import F64, Mask
from legoworld.records.evaluation_view import Fit

#: A spread below float32's resolution of the mean is rounding, not information.
_NO_SPREAD: Final = 2.0**-24


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
