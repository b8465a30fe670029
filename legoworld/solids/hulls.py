"""Measurements in the world: hulls, directions, rows. Metres, z up, float64."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

#: How far outside of a hull a point still counts as inside.
HULL_SLACK_M: Final = 1e-4
#: A direction's part on the ground below this share of its length is rounding, not a direction.
_ON_GROUND: Final = 1e-3


def hull_planes(container: Points) -> Points | None:
    """(F, 4) the outward planes of a convex hull; None where it has no volume (Qhull tells)."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(ConvexHull(container).equations, np.float64)
    except (QhullError, ValueError):
        return None


def share_inside(points: Points, planes: Points) -> float:
    """Share of (n, 3) points inside of (F, 4) planes of a hull, the slack included."""
    outside = points @ planes[:, :3].T + planes[:, 3]
    return float((outside <= HULL_SLACK_M).all(axis=1).mean())


def facing_angles_deg(front: Points, ways: Points) -> Points:
    """(...) angles on the ground between fronts and ways, (..., 3) each, 0 to 180 degrees.

    NaN where either has no direction on the ground: it points up or down to a thousandth.
    """
    on_ground = [
        np.hypot(d[..., 0], d[..., 1]) > _ON_GROUND * np.sqrt((d * d).sum(axis=-1))
        for d in (front, ways)
    ]
    cross = front[..., 0] * ways[..., 1] - front[..., 1] * ways[..., 0]
    along = front[..., 0] * ways[..., 0] + front[..., 1] * ways[..., 1]
    angles = np.abs(np.degrees(np.arctan2(cross, along)))
    return np.where(on_ground[0] & on_ground[1], angles, np.nan)


def step_deviation(centres: Sequence[Points]) -> float | None:
    """Largest distance of a step from the mean step, over the mean step's length.

    centres: (3,) each. None where all of them are one place.
    """
    steps = np.diff(np.asarray(centres), axis=0)
    mean = steps.mean(axis=0)
    size = float(np.linalg.norm(mean))
    return float(np.linalg.norm(steps - mean, axis=1).max()) / size if size > 1e-9 else None


def scales(world_from_mesh: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """(3,) lengths of the axes of a (3, 4) placement, and its determinant."""
    linear = world_from_mesh[:, :3]
    return np.sqrt((linear**2).sum(axis=0)), float(np.linalg.det(linear))
