"""Lens distortion by COLMAP's polynomial models: from a distorted pixel to the pinhole's pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Coefficients = tuple[float, float, float, float, float, float, float, float]

_MAX_STEPS: Final = 50
#: In normalised image coordinates: 1e-12 is some 4e-9 pixels of a 6048 px wide photo.
_CONVERGED: Final = 1e-12


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A distortion. coefficients: k1, k2, p1, p2, k3, k4, sx1, sy1 (COLMAP, sensor/models.h).

    fisheye: whether they apply to the equidistant projection, whose radius is the angle.
    """

    coefficients: Coefficients
    fisheye: bool = False


@dataclass(frozen=True, kw_only=True)
class UndistortedPixels:
    """Pixels of the pinhole with the same fx, fy, cx, cy: xy_px (n, 2), NaN without a ray.

    folded, unsolved, behind: (n,) bool, why there is no ray in front of the camera: the distortion
    folds over, Newton's method does not converge, 90 degrees or more off axis.
    """

    xy_px: F64
    folded: NDArray[np.bool_]
    unsolved: NDArray[np.bool_]
    behind: NDArray[np.bool_]


def undistort(
    lens: Lens, focal: tuple[float, float], centre: tuple[float, float], xy_px: F64
) -> UndistortedPixels:
    """Where the pinhole sees what the lens shows at pixels (n, 2), x and y from the top left."""
    uv, folded, unsolved = _solve((xy_px - centre) / focal, lens.coefficients)
    behind = np.zeros(len(uv), bool)
    if lens.fisheye:
        theta = np.hypot(uv[:, 0], uv[:, 1])
        behind = theta >= np.pi / 2
        theta[behind] = np.nan
        # Equidistant fisheye to pinhole: the radius theta becomes tan(theta).
        stretch = np.ones_like(theta)
        np.divide(np.tan(theta), theta, out=stretch, where=~(theta <= 1e-9))
        uv = uv * stretch[:, None]
    xy = uv * focal + np.asarray(centre)
    return UndistortedPixels(xy_px=xy, folded=folded, unsolved=unsolved, behind=behind)


def _solve(
    distorted_uv: F64, coefficients: Coefficients
) -> tuple[F64, NDArray[np.bool_], NDArray[np.bool_]]:
    """uv + distortion(uv) = distorted_uv for (n, 2) uv by Newton's method, NaN where none is."""
    uv = distorted_uv.copy()
    folded = np.zeros(len(uv), bool)
    moving = np.ones(len(uv), bool)
    with np.errstate(invalid="ignore", over="ignore"):
        for _ in range(_MAX_STEPS):
            value, (f_u, f_v, g_u, g_v) = distort(uv, coefficients)
            error = value - distorted_uv
            determinant = f_u * g_v - f_v * g_u
            folded |= determinant <= 0
            uv[folded] = np.nan
            step_u = (g_v * error[:, 0] - f_v * error[:, 1]) / determinant
            step_v = (f_u * error[:, 1] - g_u * error[:, 0]) / determinant
            uv = uv - np.stack([step_u, step_v], axis=1)
            moving = ~(np.maximum(np.abs(step_u), np.abs(step_v)) < _CONVERGED) & ~folded
            if not moving.any():
                break
    uv[moving] = np.nan
    return uv, folded, moving


def distort(uv: F64, coefficients: Coefficients) -> tuple[F64, tuple[F64, F64, F64, F64]]:
    """COLMAP's thin prism distortion of (n, 2) uv, and its four partial derivatives.

    With r2 = u^2 + v^2 and R = k1 r2 + k2 r2^2 + k3 r2^3 + k4 r2^4:
    f = u + u R + 2 p1 u v + p2 (r2 + 2 u^2) + sx1 r2, g = v + v R + 2 p2 u v + p1 (r2 + 2 v^2)
    + sy1 r2 (COLMAP, sensor/models.h, ThinPrismFisheyeCameraModel).
    """
    k1, k2, p1, p2, k3, k4, sx1, sy1 = coefficients
    u, v = uv[:, 0], uv[:, 1]
    uu, uv_product, vv = u * u, u * v, v * v
    r2 = uu + vv
    radial = r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    slope = k1 + r2 * (2 * k2 + r2 * (3 * k3 + r2 * 4 * k4))  # of radial, by r2
    f = u + u * radial + 2 * p1 * uv_product + p2 * (r2 + 2 * uu) + sx1 * r2
    g = v + v * radial + 2 * p2 * uv_product + p1 * (r2 + 2 * vv) + sy1 * r2
    f_u = 1 + radial + 2 * uu * slope + 2 * p1 * v + 6 * p2 * u + 2 * sx1 * u
    f_v = 2 * uv_product * slope + 2 * p1 * u + 2 * p2 * v + 2 * sx1 * v
    g_u = 2 * uv_product * slope + 2 * p2 * v + 2 * p1 * u + 2 * sy1 * u
    g_v = 1 + radial + 2 * vv * slope + 2 * p2 * u + 6 * p1 * v + 2 * sy1 * v
    return np.stack([f, g], axis=1), (f_u, f_v, g_u, g_v)
