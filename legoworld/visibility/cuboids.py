"""Boxes in space by their corners, and as lines in a picture.

Corners are Omni3D's, in the camera frame (x right, y down, z forward), metres: with the box's own
axes x (length), y (height, downwards) and z (width), v0 v1 v2 v3 go around the side of smaller z
from (-, -) over (+, -) and (+, +) to (-, +), and v4 v5 v6 v7 lie behind them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: (8, 3) signs of the corners along the box's own axes.
SIGNS: Final[Floats] = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1],
     [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], np.float64,
)  # fmt: skip
EDGES: Final = (
    (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
)  # fmt: skip
#: What lies nearer is cut off before lines are projected, metres.
_NEAREST_M: Final = 1e-3


def cuboid_corners(center: Floats, axes: Floats, size_xyz: Floats) -> Floats:
    """(8, 3) corners of a box. axes: (3, 3), its own axes as columns."""
    half = SIGNS * (size_xyz / 2)
    return np.stack(
        [center[r] + half[:, 0] * axes[r, 0] + half[:, 1] * axes[r, 1] + half[:, 2] * axes[r, 2]
         for r in range(3)], axis=1,
    )  # fmt: skip


def edge_vectors(corners: Floats) -> Floats:
    """(..., 3, 3) mean edges along the box's x, y and z, as rows, of (..., 8, 3) corners."""
    edges: Floats = np.einsum("kc,...kd->...cd", SIGNS, corners) / 4
    return edges


def measure_cuboid(corners: Floats) -> tuple[Floats, Floats, list[float]]:
    """Centre, axes as columns, and sizes along them of (8, 3) corners; a flat axis is zeros."""
    edges = edge_vectors(corners)
    sizes = np.sqrt((edges**2).sum(axis=1))
    axes = np.divide(edges, sizes[:, None], out=np.zeros((3, 3)), where=sizes[:, None] > 0)
    return corners.mean(axis=0), axes.T, sizes.tolist()


def lines_px(corners: NDArray[Any], intrinsics: Sequence[Sequence[float]]) -> list[list[float]]:
    """The edges of a box, (8, 3), in a picture: x, y, x, y each; without those behind the camera.

    intrinsics: rows of K in pixels, the centre of the first pixel at (0.5, 0.5).
    """
    (fx, skew, cx), (_, fy, cy), _ = (map(float, row) for row in intrinsics)
    lines = []
    for a, b in EDGES:
        p, q = (np.asarray(corners[k], np.float64) for k in (a, b))
        if max(p[2], q[2]) < _NEAREST_M:
            continue
        if min(p[2], q[2]) < _NEAREST_M:
            cut = p + (q - p) * ((_NEAREST_M - p[2]) / (q[2] - p[2]))
            p, q = (cut, q) if p[2] < q[2] else (p, cut)
        line = []
        for x, y, z in (p.tolist(), q.tolist()):
            line += [(fx * x + skew * y) / z + cx, fy * y / z + cy]
        lines.append(line)
    return lines


def extent_px(lines: Sequence[Sequence[float]], size_wh: tuple[int, int]) -> list[float]:
    """x, y, width, height of lines inside a picture; zeros where none of it is there."""
    if not lines:
        return [0.0, 0.0, 0.0, 0.0]
    points = np.array(lines, np.float64).reshape(-1, 2)
    low, high = np.clip([points.min(0), points.max(0)], 0, size_wh)
    x0, y0, x1, y1 = low[0], low[1], high[0], high[1]
    return [float(x0), float(y0), float(x1 - x0), float(y1 - y0)]
