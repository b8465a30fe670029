"""A region of a photo as the network's input, and its nine points as a box in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

#: (8, 3) signs of points 1..8 along the object's x, y (its height) and z; point 0 is the centre.
SIGNS: Floats = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
#: The points in the order of Omni3D's corners.
OMNI3D = [0, 4, 6, 2, 1, 5, 7, 3]


def square_around(bbox: Any) -> tuple[float, float, float]:
    """Left, top, side of MediaPipe's crop: 1.5 times the longer side of x, y, width, height."""
    x, y, width, height = map(float, bbox)
    side = 1.5 * max(width, height)
    return x + (width - side) / 2, y + (height - side) / 2, side


def crop(photo: NDArray[np.uint8], square: tuple[float, float, float], n: int) -> NDArray[Any]:
    """(n, n, 3) float32 of 0 to 1: bilinear at pixel centres, the photo's edge repeated."""
    at = (np.arange(n) + 0.5) * square[2] / n - 0.5
    rows, columns = (np.clip(at + square[1 - k], 0, photo.shape[k] - 1) for k in (0, 1))
    y, x = rows.astype(int), columns.astype(int)
    v, u = (rows - y)[:, None, None], (columns - x)[None, :, None]
    padded = np.pad(photo, ((0, 1), (0, 1), (0, 0)), "edge")
    upper, lower = (padded[r][:, x] * (1 - u) + padded[r][:, x + 1] * u for r in (y, y + 1))
    return ((upper * (1 - v) + lower * v) / 255).astype(np.float32)


def camera_of(fov_deg: float, size_wh: tuple[int, int]) -> Floats:
    """K of a photo, its longer side seen under an angle."""
    focal = max(size_wh) / 2 / np.tan(np.radians(fov_deg) / 2)
    return np.array([[focal, 0, size_wh[0] / 2], [0, focal, size_wh[1] / 2], [0, 0, 1]])


def box_in_space(points_px: Floats, camera: Floats, height_m: float) -> Floats | None:
    """(8, 3) corners in metres in Omni3D's order; None where no box is before the camera.

    EPnP's axes are not quite orthogonal: from the nearest orthogonal ones, the box whose nine
    points are nearest to the given ones in the photo.
    """
    seen = (np.column_stack([points_px, np.ones(9)]) @ np.linalg.inv(camera).T)[:, :2]
    center, half = lifted(seen)
    lengths = np.linalg.norm(half, axis=0)
    if min(center[2], *lengths) <= 1e-9 or np.ptp(seen, axis=0).min() <= 1e-9:
        return None
    left, _, right = np.linalg.svd(half / lengths)

    def points(x: Floats) -> Floats:  # x, y at z 1; a turn; logarithms of half sizes
        axes = Rotation.from_rotvec(x[2:5]).as_matrix() @ left @ right
        signs = np.vstack([np.zeros(3), SIGNS])
        return np.append(x[:2], 1) + (signs * np.exp(x[5:])) @ axes.T

    def off(x: Floats) -> Floats:
        at = points(x)
        return (at[:, :2] / np.maximum(at[:, 2:], 1e-3) - seen).ravel()

    start = [*center[:2] / center[2], 0, 0, 0, *np.log(lengths / center[2])]
    best = least_squares(off, start, method="lm", max_nfev=400).x
    corners = points(best)[1:][OMNI3D] * height_m / 2 / np.exp(best[6])
    return corners if np.isfinite(corners).all() and corners[:, 2].min() > 0 else None


def lifted(seen: Floats) -> tuple[Floats, Floats]:
    """MediaPipe's EPnP: centre (3,) and half axes (3, 3), as columns, up to scale.

    seen: (9, 2) at focal length 1. The centre lies before the camera; its own point is unused.
    """
    weights = np.column_stack([1 - SIGNS.sum(axis=1), SIGNS])
    equations = np.zeros((8, 2, 4, 3))
    for k in (0, 1):
        equations[:, k, :, k] = weights
        equations[:, k, :, 2] = -weights * seen[1:, k, None]
    control = np.linalg.svd(equations.reshape(16, 12))[2][-1].reshape(4, 3)
    control = control if control[0, 2] > 0 else -control
    return control[0], (control[1:] - control[0]).T
