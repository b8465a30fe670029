"""How far apart the surfaces of two solids are. Metres, float64."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import fcl
import numpy as np
from numpy.typing import NDArray

from legoworld.solids.penetration import collision_model

Triangles = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Solid:
    """One thing in the world as its triangles, (T, 3, 3) metres, with what is made of them once."""

    triangles: Triangles

    @cached_property
    def model(self) -> Any:
        """Its triangles as FCL has them."""
        return collision_model(self.triangles)

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """(N, 3) its corners, each once."""
        return np.unique(self.triangles.reshape(-1, 3), axis=0)


def surface_distance_m(first: Solid, second: Solid) -> float:
    """The least distance between the surfaces of two solids: 0 where they meet.

    Also where one lies inside the other: the way from its surface to the other's.
    """
    apart = fcl.distance(first.model, second.model, fcl.DistanceRequest(), fcl.DistanceResult())
    return max(0.0, float(apart))
