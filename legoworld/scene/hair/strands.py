"""Strands of hair as Cycles draws them: Catmull-Rom splines through keys, each key with a radius.

Their surfaces (`ribbons`, `tubes`) are tessellated for one camera, by distance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.affine import cross, dot, inverse, length, transform_points, unit

#: Largest deviation from what Cycles draws, as a share of its distance: a twentieth of a
#: pixel in a picture 8,000 pixels wide.
TOLERANCE: Final = 5e-6

_KEYS_AT_ONCE: Final = 1 << 13


@dataclass(frozen=True, kw_only=True)
class Strands:
    """Strands of at least two keys each, in their object's frame.

    points: (K, 3) float64; radius: (K,) float64; start: (C + 1,) int64, strand c owns the keys
    [start[c], start[c + 1]).
    """

    points: NDArray[np.float64]
    radius: NDArray[np.float64]
    start: NDArray[np.int64]

    def parts(self) -> Iterator[Self]:
        """The same strands in batches, to bound memory."""
        first = 0
        while first < len(self.start) - 1:
            enough = np.searchsorted(self.start, self.start[first] + _KEYS_AT_ONCE)
            last = min(int(enough), len(self.start) - 1)
            keys = slice(int(self.start[first]), int(self.start[last]))
            yield type(self)(
                points=self.points[keys],
                radius=self.radius[keys],
                start=self.start[first : last + 1] - self.start[first],
            )
            first = last


def usable(
    points: NDArray[np.float64], radius: NDArray[np.float64], start: NDArray[np.int64]
) -> Strands:
    """The strands with more than one key, which are drawn. Arrays: (K, 3), (K,), (C + 1,)."""
    count = np.diff(start)
    keep = count >= 2
    keys = np.repeat(keep, count)
    return Strands(
        points=points[keys],
        radius=np.maximum(radius[keys], 0.0),
        start=np.concatenate([[0], np.cumsum(count[keep])]).astype(np.int64),
    )


@dataclass(frozen=True, kw_only=True)
class Eye:
    """The camera in an object's frame.

    cam_from_mesh: (3, 4) float64, not flat. ortho_scale: the width of an orthographic view in
    scene units; None for a perspective one.
    """

    cam_from_mesh: NDArray[np.float64]
    ortho_scale: float | None

    @classmethod
    def of(cls, cam_from_mesh: NDArray[np.float64], ortho_scale: float | None) -> Self | None:
        """None for a singular transform: Cycles then draws nothing."""
        try:
            inverse(cam_from_mesh.tolist())
        except ZeroDivisionError:
            return None
        return cls(cam_from_mesh=cam_from_mesh, ortho_scale=ortho_scale)

    @property
    def stretch(self) -> float:
        """The largest scale factor of the transform."""
        return float(length(self.cam_from_mesh[:, :3].T).max())

    def toward(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 3) directions, in the object's frame, in which the camera looks at points."""
        back = np.array(inverse(self.cam_from_mesh.tolist()))
        if self.ortho_scale is not None:
            return np.broadcast_to(back[:, 2], points.shape)
        origin = -transform_points(back, self.cam_from_mesh[:, 3], directions=True)
        return points - origin

    def reach(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(...) distances to points in scene units; the view's width where it is orthographic."""
        if self.ortho_scale is not None:
            return np.full(points.shape[:-1], self.ortho_scale)
        return length(transform_points(self.cam_from_mesh, points))

    def share(self, points: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
        """(...) size / distance of something at a point."""
        distance = self.reach(points)
        return np.divide(
            size * self.stretch, distance, out=np.full_like(distance, np.inf), where=distance > 0
        )


@dataclass(frozen=True, kw_only=True)
class Nodes:
    """Points along strands in order: (N, 3) points and unit tangents, (N,) radius.

    last: (N,) bool, true for the last node of each strand.
    """

    points: NDArray[np.float64]
    tangent: NDArray[np.float64]
    radius: NDArray[np.float64]
    last: NDArray[np.bool_]

    @property
    def pairs(self) -> NDArray[np.int64]:
        """(P,) the nodes that are not the last of their strand."""
        return np.flatnonzero(~self.last)


def nodes(strands: Strands, eye: Eye, per_segment: int, straighten: bool) -> Nodes:
    """`per_segment` steps between every two keys, or one where the strand is nearly straight.

    The spline is Cycles' (catmull_rom_basis_eval); at a strand's ends the last key counts twice.
    """
    is_last = np.zeros(len(strands.points), bool)
    is_last[strands.start[1:] - 1] = True
    is_first = np.zeros(len(strands.points), bool)
    is_first[strands.start[:-1]] = True
    number = np.arange(len(strands.points))
    before, after = number - ~is_first, number + ~is_last
    slope = 0.5 * (strands.points[after] - strands.points[before])
    way = np.where(is_last[:, None], slope, strands.points[after] - strands.points)
    slope = _nonzero_slopes(slope, way)
    bent = ~is_last
    if straighten:
        bent &= _bends(strands, slope, way, (before, after), eye)
    place = np.cumsum(np.concatenate([[0], np.where(bent, per_segment, 1)]))
    points = np.empty((place[-1], 3))
    tangent, radius, last = np.empty_like(points), np.empty(place[-1]), np.zeros(place[-1], bool)
    points[place[:-1]], tangent[place[:-1]] = strands.points, slope
    radius[place[:-1]], last[place[:-1]] = strands.radius, is_last
    k1 = np.flatnonzero(bent)
    u = np.arange(1, per_segment) / per_segment
    keys = (before[k1], k1, after[k1], after[after[k1]])
    inner = place[k1][:, None] + np.arange(1, per_segment)
    points[inner] = _weight_keys(strands.points, keys, _basis(u))
    tangent[inner] = _nonzero_slopes(
        _weight_keys(strands.points, keys, _basis_slope(u)), way[k1][:, None]
    )
    radius[inner] = _weight_keys(strands.radius[:, None], keys, _basis(u))[..., 0]
    return Nodes(points=points, tangent=unit(tangent), radius=np.maximum(radius, 0.0), last=last)


def side(tangent: NDArray[np.float64], ray: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) unit vectors to the left of a strand, perpendicular to a ray; 0 if parallel."""
    return unit(cross(tangent, ray))


def _basis(u: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    s = 1.0 - u
    return [
        0.5 * -u * s * s,
        0.5 * (2.0 + u * u * (3.0 * u - 5.0)),
        0.5 * (2.0 + s * s * (3.0 * s - 5.0)),
        0.5 * -s * u * u,
    ]


def _basis_slope(u: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    s = 1.0 - u
    return [
        0.5 * (-s * s + 2.0 * s * u),
        0.5 * (2.0 * u * (3.0 * u - 5.0) + 3.0 * u * u),
        0.5 * (2.0 * s * (3.0 * u + 2.0) - 3.0 * s * s),
        0.5 * (-2.0 * s * u + u * u),
    ]


def _weight_keys(
    values: NDArray[np.float64],
    keys: tuple[NDArray[np.int64], ...],
    weights: list[NDArray[np.float64]],
) -> NDArray[np.float64]:
    total = np.zeros((len(keys[0]), len(weights[0]), values.shape[1]))
    for key, weight in zip(keys, weights, strict=True):
        total += values[key][:, None, :] * weight[:, None]
    return total


def _nonzero_slopes(slope: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slopes; where they are 0, the step to the next key."""
    standing = dot(slope, slope) <= 1e-18 * dot(way, way)
    return np.where(standing[..., None], way, slope)


def _bends(
    strands: Strands,
    slope: NDArray[np.float64],
    way: NDArray[np.float64],
    beside: tuple[NDArray[np.int64], NDArray[np.int64]],
    eye: Eye,
) -> NDArray[np.bool_]:
    """(K,) bool: the keys after which a strand may deviate from a straight band by `TOLERANCE`.

    A segment's Bezier form has its inner points a third of the end slopes away from its ends, and
    the segment departs from its chord by no more than they do. Added are what the tangent's turn
    does to the edges, and a radius that does not change evenly along the chord.
    """
    before, after = beside
    radius = strands.radius
    change = radius[after] - radius
    size = dot(way, way)
    chord = np.sqrt(np.maximum(size, np.finfo(np.float64).tiny))
    off, uneven, swelling = (np.zeros_like(size) for _ in range(3))
    for end in (np.arange(len(radius)), after):
        off = np.maximum(off, length(cross(slope[end], way)) / (3.0 * chord))
        share = dot(slope[end], way) / (3.0 * chord * chord)
        uneven = np.maximum(uneven, np.abs(share - 1.0 / 3.0))
        radius_slope = 0.5 * (radius[after[end]] - radius[before[end]])
        swelling = np.maximum(swelling, np.abs(radius_slope - change) / 3.0)
    turn = 6.0 * off / chord
    departs = off + turn * np.maximum(radius, radius[after]) + swelling + uneven * np.abs(change)
    allowed = eye.reach(strands.points) * (TOLERANCE / eye.stretch)
    return np.asarray((departs > allowed) | (size == 0.0))
