"""Convex hulls in a plane, and the smallest rectangle around one; the same bits on every CPU."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Directions whose extreme points decide which others cannot be corners.
_DIRECTIONS: Final[Floats] = np.array(
    [[1, 0], [2, 1], [1, 1], [1, 2], [0, 1], [-1, 2], [-1, 1], [-2, 1],
     [-1, 0], [-2, -1], [-1, -1], [-1, -2], [0, -1], [1, -2], [1, -1], [2, -1]], np.float64,
)  # fmt: skip
#: Directions that are tried at once.
_BLOCK: Final = 256
#: Rectangles of areas, and sides, closer than this are equal: vertices are float32.
EQUAL: Final = 1e-6


def convex_hull(points: Floats) -> Floats:
    """(K, 2) corners of the hull of (n, 2) points, anticlockwise; fewer than 3 where it is flat."""
    distinct = np.unique(_outer(points), axis=0)
    if len(distinct) < 3:
        return distinct
    below, above = _chain(distinct.tolist()), _chain(distinct[::-1].tolist())
    return np.array(below[:-1] + above[:-1], np.float64)


def _outer(points: Floats) -> Floats:
    """The points that are not inside the polygon of some extreme ones."""
    if len(points) <= len(_DIRECTIONS):
        return points
    x, y = points.T
    extreme = [int((x * a + y * b).argmax()) for a, b in _DIRECTIONS.tolist()]
    corners = points[list(dict.fromkeys(extreme))]
    ends = np.roll(corners, -1, axis=0)
    inside = np.full(len(points), len(corners) > 2)
    for (ax, ay), (bx, by) in zip(corners.tolist(), ends.tolist(), strict=True):
        inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0
    return points[~inside]


def _chain(ordered: list[list[float]]) -> list[list[float]]:
    """One side of the hull of points in lexical order (Andrew's monotone chain)."""
    chain: list[list[float]] = []
    for x, y in ordered:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            chain.pop()
        chain.append([x, y])
    return chain


def smallest_rectangle(points: Floats) -> tuple[float, float]:
    """The direction (cos, sin) of a side of the smallest rectangle around (n, 2) points.

    In the first quadrant. One side lies along a side of the hull; of several that are equally small
    the one turned least is taken, as for a square or a circle.
    """
    hull = convex_hull(points)
    if len(hull) < 2:
        return 1.0, 0.0
    sides = np.roll(hull, -1, axis=0) - hull
    lengths = np.sqrt(sides[:, 0] ** 2 + sides[:, 1] ** 2)
    cos, sin = (sides[lengths > 0] / lengths[lengths > 0, None]).T
    for _ in range(3):
        turned = (cos <= 0) | (sin < 0)
        cos, sin = np.where(turned, sin, cos), np.where(turned, -cos, sin)
    areas = [np.empty(0)]
    for first in range(0, len(cos), _BLOCK):
        c, s = cos[first : first + _BLOCK, None], sin[first : first + _BLOCK, None]
        along, across = c * hull[:, 0] + s * hull[:, 1], c * hull[:, 1] - s * hull[:, 0]
        areas.append(np.ptp(along, axis=1) * np.ptp(across, axis=1))
    area = np.concatenate(areas)
    small = np.flatnonzero(area <= area.min() * (1 + EQUAL))
    best = small[np.lexsort((small, sin[small]))[0]]
    return float(cos[best]), float(sin[best])
