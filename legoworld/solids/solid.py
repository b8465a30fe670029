"""A solid: points and triangles in the world, with what is made of them once. Metres, float64."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.solids.hulls import hull_planes
from legoworld.solids.penetration import collision_model

Points = NDArray[np.float64]
Triangles = NDArray[np.float64]

#: The winding number from which a point counts as enclosed: a box has an eighth at its corners.
_ON_SURFACE: Final = 0.1


@dataclass(frozen=True, kw_only=True)
class Solid:
    """One thing in the world. points: (N, 3) its vertices; triangles: (T, 3) into them."""

    points: Points
    triangles: NDArray[np.int64]

    @cached_property
    def corners(self) -> Triangles:
        """(T, 3, 3) the corners of its triangles."""
        return self.points[self.triangles]

    @cached_property
    def model(self) -> Any:
        """Its triangles as FCL has them."""
        return collision_model(self.points, self.triangles)

    @cached_property
    def closed(self) -> bool:
        """Whether its triangles enclose a volume: each edge is passed as often either way.

        Corners at equal coordinates are one.
        """
        rows = np.ascontiguousarray(self.points + 0.0).view([("", np.float64)] * 3).ravel()
        place = np.unique(rows, return_inverse=True)[1].reshape(-1)[self.triangles]
        start, end = place.reshape(-1), np.roll(place, -1, axis=1).reshape(-1)
        n = len(rows)
        passed = np.where(start < end, start * n + end, end * n + start)
        edges, index = np.unique(passed, return_inverse=True)
        return bool(len(edges)) and not np.bincount(index, np.sign(end - start)).any()

    @cached_property
    def planes(self) -> Points | None:
        """The planes of its convex hull, as `hull_planes` has them."""
        return hull_planes(self.points)

    def share_within(self, points: Points) -> float:
        """Share of points that a closed solid encloses, its surface included.

        By their winding numbers (van Oosterom and Strackee 1983, The Solid Angle of a Plane
        Triangle): 0 outside, a multiple of 1 inside, a part of 1 on the surface.
        """
        a, b, c = np.moveaxis(self.corners[None] - points[:, None, None], 2, 0)
        p, q, r = (np.sqrt((v * v).sum(axis=-1)) for v in (a, b, c))
        dots = ((b * c).sum(-1) * p + (a * c).sum(-1) * q + (a * b).sum(-1) * r) + p * q * r
        angles = 2 * np.arctan2((a * np.cross(b, c)).sum(axis=-1), dots)
        return float((np.abs(angles.sum(axis=1)) > 4 * np.pi * _ON_SURFACE).mean())

    def distance_m(self, other: Solid) -> float:
        """The least distance between the surfaces of two solids: 0 where they meet.

        Also where one lies inside the other: the way from its surface to the other's.
        """
        import fcl

        return max(0.0, float(fcl.distance(self.model, other.model)))
