"""A solid: points and triangles in the world, with what is made of them once. Metres, float64."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.solids.hulls import hull_planes
from legoworld.solids.penetration import collision_model

Points = NDArray[np.float64]
Triangles = NDArray[np.float64]


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
        return collision_model(self.corners)

    @cached_property
    def planes(self) -> Points | None:
        """The planes of its convex hull, as `hull_planes` has them."""
        return hull_planes(self.points)

    def distance_m(self, other: Solid) -> float:
        """The least distance between the surfaces of two solids: 0 where they meet.

        Also where one lies inside the other: the way from its surface to the other's.
        """
        import fcl

        return max(0.0, float(fcl.distance(self.model, other.model)))
