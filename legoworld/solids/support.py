"""What an entity rests on: contact along vertical lines, and its centre of mass. Metres, z up."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Triangles = NDArray[np.float64]

#: Vertical lines along x and y, evenly over the entity, and more at its lowest corners.
_LINES: Final = 64
#: What is this much farther from the ground than the nearest point is in contact, too: at most
#: 1 cm, and 5 % of the entity's height, so that a tilted cup does not rest on its side.
_BAND_M: Final = 0.01
_BAND_SHARE: Final = 0.05
_HAIR: Final = 1e-6
#: A triangle over so many lines is met by itself, on its part of their grid.
_MANY_LINES: Final = 256
#: Lines of triangles that are met at a time.
_MOST_HITS: Final = 4_000_000


@dataclass(frozen=True, kw_only=True)
class RestContact:
    """Support of an entity. gap_m: to the surface below; negative if it penetrates.

    balanced: whether its centre of mass is above the convex hull of its contact, to 1/64 of its
    size. contact: (C, 2) x and y where it rests, and what is between them does not matter; centre:
    (2,) of its centre of mass.
    """

    gap_m: float
    balanced: bool
    contact: Points
    centre: Points

    @property
    def margin_m(self) -> float:
        """How far inside the hull of its contact the centre of mass is; outside of it below 0."""
        import cv2

        hull = cv2.convexHull((self.contact - self.centre).astype(np.float32))
        return float(cv2.pointPolygonTest(hull, (0.0, 0.0), measureDist=True))


def rest_on(own: Triangles, below: Triangles) -> RestContact | None:
    """How an entity's triangles rest on others, (T, 3, 3); None where nothing is below it.

    On each vertical line the highest surface that is not above the entity counts: what pokes
    through its floor is sunk into it, however far. The least gap of all lines is the entity's.
    """
    if not len(below):
        return None
    x, y = (
        line[(line >= below[..., axis].min()) & (line <= below[..., axis].max())]
        for axis, line in enumerate(_lines(own))
    )
    low, high = _heights(own, x, y)
    _, under = _heights(below, x, y, high)
    met = np.isfinite(low) & np.isfinite(under)
    if not met.any():
        return None
    gaps = np.where(met, low - np.where(met, under, 0.0), np.inf)
    least = float(gaps.min())
    height = float(np.ptp(own[:, :, 2]))
    contact = _outermost(gaps <= least + min(_BAND_M, _BAND_SHARE * height), x, y)
    half = np.ptp(own[:, :, :2].reshape(-1, 2), axis=0) / (2 * _LINES)
    centre = centre_of_mass(own)[:2]
    balanced = _above(centre, contact, half)
    return RestContact(gap_m=least, balanced=balanced, contact=contact, centre=centre)


def centre_of_mass(triangles: Triangles) -> Points:
    """(3,) of a closed surface's volume; of its area where it encloses nothing."""
    middle = triangles.mean(axis=(0, 1))
    a, b, c = np.moveaxis(triangles - middle, 1, 0)
    cross = np.cross(b - a, c - a)
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    volume = float(volumes.sum())
    box = float(np.prod(np.ptp(triangles.reshape(-1, 3), axis=0)))
    if abs(volume) > 1e-3 * box:
        inner = (volumes[:, None] * (a + b + c) / 4).sum(axis=0) / volume
        if (np.abs(inner) <= np.abs(np.stack([a, b, c])).max(axis=(0, 1))).all():
            return np.asarray(middle + inner)
    areas = np.linalg.norm(cross, axis=1)
    if not areas.sum():
        return np.asarray(middle)
    return np.asarray(middle + (areas[:, None] * (a + b + c) / 3).sum(axis=0) / areas.sum())


def _lines(own: Triangles) -> tuple[Points, Points]:
    """x and y of the vertical lines: evenly, and at and between the lowest corners (thin legs)."""
    points = own.reshape(-1, 3)
    feet = points[points[:, 2] <= points[:, 2].min() + _BAND_M]
    axes = []
    for axis in (0, 1):
        low, high = points[:, axis].min(), points[:, axis].max()
        even = low + (np.arange(_LINES) + 0.5) * (high - low) / _LINES
        corners = np.unique(feet[:, axis])
        between = (corners[1:] + corners[:-1]) / 2
        # A hair inwards: a corner that stands flush with an edge is carried by it.
        corners = corners + _HAIR * ((low + high) / 2 - corners)
        more = [some[:: len(some) // _LINES + 1] for some in (corners, between)]
        axes.append(np.unique(np.concatenate([even, *more])))
    return axes[0], axes[1]


def _outermost(touching: NDArray[np.bool_], x: Points, y: Points) -> Points:
    """(C, 2) the first and last touching line of each x: the others are not on the hull."""
    rows = np.flatnonzero(touching.any(axis=1))
    first = touching[rows].argmax(axis=1)
    last = len(y) - 1 - touching[rows, ::-1].argmax(axis=1)
    return np.stack([np.tile(x[rows], 2), y[np.concatenate([first, last])]], axis=1)


def _heights(
    triangles: Triangles, x: Points, y: Points, most: Points | None = None
) -> tuple[Points, Points]:
    """(X, Y) lowest and highest z of triangles on each line; inf and -inf where there is none.

    most: (X, Y) looks for the highest up to that alone. What is seen from the edge is on no line.
    """
    low = np.full((len(x), len(y)), np.inf)
    high = np.full((len(x), len(y)), -np.inf)
    u, v = (triangles[:, k, :2] - triangles[:, 0, :2] for k in (1, 2))
    triangles = triangles[u[:, 0] * v[:, 1] != u[:, 1] * v[:, 0]]
    corners, others = triangles[:, :, :2].min(axis=1), triangles[:, :, :2].max(axis=1)
    x0, x1 = np.searchsorted(x, corners[:, 0]), np.searchsorted(x, others[:, 0], "right")
    y0, y1 = np.searchsorted(y, corners[:, 1]), np.searchsorted(y, others[:, 1], "right")
    counts = (x1 - x0) * (y1 - y0)
    large = counts >= _MANY_LINES
    for n in np.flatnonzero(large).tolist():
        part = slice(x0[n], x1[n]), slice(y0[n], y1[n])
        z, hit = _height_at(triangles[n].tolist(), x[part[0], None], y[None, part[1]])
        if most is None:
            np.minimum(low[part], np.where(hit, z, np.inf), out=low[part])
        else:
            hit &= z <= most[part]
        np.maximum(high[part], np.where(hit, z, -np.inf), out=high[part])
    near = np.flatnonzero((counts > 0) & ~large)
    ends = np.cumsum(counts[near])
    for chunk in np.split(near, np.flatnonzero(np.diff(ends // _MOST_HITS)) + 1):
        owner = np.repeat(chunk, counts[chunk])
        first = np.cumsum(counts[chunk]) - counts[chunk]
        nth = np.arange(len(owner)) - np.repeat(first, counts[chunk])
        wide = (y1 - y0)[owner]
        i, j = x0[owner] + nth // wide, y0[owner] + nth % wide
        z, hit = _height_at(np.moveaxis(triangles[owner], 0, -1), x[i], y[j])
        if most is not None:
            hit &= z <= most[i, j]
        line, z = (i * len(y) + j)[hit], z[hit]
        if most is None:
            np.minimum.at(low.reshape(-1), line, z)
        np.maximum.at(high.reshape(-1), line, z)
    return low, high


def _height_at(
    corners: Iterable[Iterable[Points]], x: Points, y: Points
) -> tuple[Points, NDArray[np.bool_]]:
    """z of planes of triangles on vertical lines, and where the triangle is hit.

    corners: x, y and z of each of three, numbers or arrays.
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    w0, w1 = x - ax, y - ay
    u0, u1, v0, v1 = bx - ax, by - ay, cx - ax, cy - ay
    area = u0 * v1 - u1 * v0
    s = (w0 * v1 - w1 * v0) / area
    t = (u0 * w1 - u1 * w0) / area
    hit = (s >= 0) & (t >= 0) & (s + t <= 1)
    return az + s * (bz - az) + t * (cz - az), hit


def _above(point: Points, contact: Points, half: Points) -> bool:
    """Whether a point lies in the convex hull of rectangles around contact points.

    contact: as `_outermost` has them. Most points lie in one row's own.
    """
    from scipy.spatial import ConvexHull

    half = np.maximum(half, 1e-9)
    first, last = contact[: len(contact) // 2], contact[len(contact) // 2 :]
    rows = (np.abs(first[:, 0] - point[0]) <= half[0]) & (first[:, 1] <= point[1] + half[1])
    if (rows & (last[:, 1] >= point[1] - half[1])).any():
        return True
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]], np.float64)
    hull = ConvexHull((contact[:, None] + signs * half).reshape(-1, 2))
    return bool((hull.equations[:, :2] @ point + hull.equations[:, 2] <= 1e-9).all())
