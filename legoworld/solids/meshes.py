"""Surfaces of a snapshot in the world: points, triangles and fronts. Metres, z up, float64."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.affine import transform_points
from legoworld.scene.snapshot import Snapshot
from legoworld.solids.solid import Solid

Points = NDArray[np.float64]


def surface_points_m(snapshot: Snapshot, surface: int) -> Points:
    """(N, 3) the world coordinates of one surface's vertices."""
    mesh = int(snapshot.surface_mesh[surface])
    vertices = snapshot.vertices[slice(*snapshot.vertex_start[mesh : mesh + 2].tolist())]
    world = transform_points(snapshot.world_from_mesh[surface], vertices.astype(np.float64))
    return world * snapshot.render.unit_scale


def surfaces_solid(snapshot: Snapshot, surfaces: Sequence[int]) -> Solid:
    """Some surfaces of the world as one solid."""
    points: list[Points] = []
    triangles: list[NDArray[np.int64]] = []
    count = 0
    for surface in surfaces:
        mesh = int(snapshot.surface_mesh[surface])
        own = snapshot.triangles[slice(*snapshot.triangle_start[mesh : mesh + 2].tolist())]
        triangles.append(own.astype(np.int64) + count)
        points.append(surface_points_m(snapshot, surface))
        count += len(points[-1])
    if len(points) == 1:
        return Solid(points=points[0], triangles=triangles[0])
    return Solid(
        points=np.concatenate([np.empty((0, 3)), *points]),
        triangles=np.concatenate([np.empty((0, 3), np.int64), *triangles]),
    )


def own_front(snapshot: Snapshot, index: int) -> Points | None:
    """(3,) an object's own -Y axis in the world; None where it has no surface of its own."""
    own = (snapshot.occurrence_object == index) & (snapshot.occurrence_instancer < 0)
    surfaces = np.flatnonzero(own[snapshot.surface_occurrence])
    if not len(surfaces):
        return None
    return np.asarray(-snapshot.world_from_mesh[surfaces[0]][:, 1])
