"""Measurements in the world: gaps, hulls, contacts, directions, rows. Metres, z up, float64."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Triangles = NDArray[np.float64]

#: An entity rests on the points this close above its lowest one.
_FOOT_M: Final = 0.01
#: A surface up to this far above a foot is one the entity is sunk into.
_SUNK_M: Final = 0.10


def support_gap_m(feet: Points, below: Triangles) -> float | None:
    """The largest gap straight below an entity's foot points to a surface under or in them.

    feet: `foot_points`. A surface up to 10 cm above a foot counts as touching it (the entity is
    sunk in): its gap is negative. None where a foot has no surface below: nothing carries it.
    """
    gaps = [_gap_below(foot, below) for foot in feet]
    return None if not gaps or None in gaps else max(gap for gap in gaps if gap is not None)


def foot_points(points: Points) -> Points:
    """Up to four points an entity stands on: the extreme ones of its lowest centimetre.

    The farthest along x and y in both directions; equal ones by their coordinates.
    """
    if not len(points):
        return points
    lowest = np.unique(points[points[:, 2] <= points[:, 2].min() + _FOOT_M], axis=0)
    corners = {int(np.argmin(sign * lowest[:, axis])) for axis in (0, 1) for sign in (1, -1)}
    # A hair inwards: a corner that stands flush with an edge is carried by it.
    chosen = lowest[sorted(corners)]
    return np.asarray(chosen + (lowest.mean(axis=0) - chosen) * [1e-3, 1e-3, 0.0])


def _gap_below(foot: Points, triangles: Triangles) -> float | None:
    x, y, z = foot.tolist()
    low, high = triangles[:, :, :2].min(axis=1), triangles[:, :, :2].max(axis=1)
    near = ((low <= (x, y)) & (high >= (x, y))).all(axis=1)
    a, b, c = np.moveaxis(triangles[near], 1, 0)
    # Barycentric coordinates of the vertical line through the foot.
    u, v, w = b[:, :2] - a[:, :2], c[:, :2] - a[:, :2], np.array([x, y]) - a[:, :2]
    det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    flat = det == 0
    det[flat] = 1.0
    s = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / det
    t = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / det
    hit = ~flat & (s >= 0) & (t >= 0) & (s + t <= 1)
    height = (a[:, 2] + s * (b[:, 2] - a[:, 2]) + t * (c[:, 2] - a[:, 2]))[hit]
    under = height[height <= z + _SUNK_M]
    return z - float(under.max()) if len(under) else None


def share_inside(points: Points, container: Points) -> float | None:
    """Share of points in the convex hull of others, a tenth of a millimetre of slack included.

    None where the container has no volume (scipy's Qhull tells).
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(container)
    except (QhullError, ValueError):
        return None
    outside = points @ hull.equations[:, :3].T + hull.equations[:, 3]
    return float((outside <= 1e-4).all(axis=1).mean())


def penetration_m(first: Triangles, second: Triangles) -> float:
    """How far two triangle meshes reach into each other, metres; 0 where they do not touch.

    The deepest contact that FCL reports between their triangles: exact for flat sides, a lower
    bound for curved ones. Surfaces that only touch have a depth of 0, and so has an entity inside
    another whose surfaces do not meet: `share_inside` tells.
    """
    import fcl

    request = fcl.CollisionRequest(num_max_contacts=10_000, enable_contact=True)
    result = fcl.CollisionResult()
    fcl.collide(_model(first), _model(second), request, result)
    return max((abs(float(contact.penetration_depth)) for contact in result.contacts), default=0.0)


def _model(triangles: Triangles) -> Any:
    import fcl

    model = fcl.BVHModel()
    vertices = triangles.reshape(-1, 3)
    model.beginModel(len(vertices), len(triangles))
    model.addSubModel(vertices, np.arange(len(vertices)).reshape(-1, 3))
    model.endModel()
    return fcl.CollisionObject(model)


def facing_angle_deg(
    world_from_mesh: NDArray[np.float64], here: Points, there: Points
) -> float | None:
    """Angle on the ground between an object's -Y axis and the way to another place, degrees.

    world_from_mesh: (3, 4). None where either has no direction on the ground.
    """
    front = -world_from_mesh[:2, 1]
    way = (there - here)[:2]
    if math.hypot(*front) < 1e-9 or math.hypot(*way) < 1e-9:
        return None
    cross = front[0] * way[1] - front[1] * way[0]
    return abs(math.degrees(math.atan2(cross, float(front @ way))))


def step_deviation(centres: Sequence[Points]) -> float | None:
    """Largest distance of a step from the mean step, over the mean step's length.

    None where all centres are one place.
    """
    steps = np.diff(np.asarray(centres), axis=0)
    mean = steps.mean(axis=0)
    size = float(np.linalg.norm(mean))
    return float(np.linalg.norm(steps - mean, axis=1).max()) / size if size > 1e-9 else None


def scales(world_from_mesh: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Lengths of a placement's three axes, and the determinant of its 3 x 3 part."""
    linear = world_from_mesh[:, :3]
    return np.sqrt((linear**2).sum(axis=0)), float(np.linalg.det(linear))
