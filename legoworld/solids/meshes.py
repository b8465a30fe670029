"""Surfaces of a snapshot in the world: points, triangles and fronts. Metres, z up, float64."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.affine import transform_points
from legoworld.scene.snapshot import Snapshot

Points = NDArray[np.float64]
Triangles = NDArray[np.float64]


def surface_points_m(snapshot: Snapshot, surface: int) -> Points:
    """(N, 3) the world coordinates of one surface's vertices."""
    mesh = int(snapshot.surface_mesh[surface])
    vertices = snapshot.vertices[slice(*snapshot.vertex_start[mesh : mesh + 2].tolist())]
    world = transform_points(snapshot.world_from_mesh[surface], vertices.astype(np.float64))
    return world * snapshot.render.unit_scale


def triangles_m(snapshot: Snapshot, surfaces: Sequence[int]) -> Triangles:
    """(T, 3, 3) corners of the triangles of some surfaces in the world."""
    parts = [np.empty((0, 3, 3), np.float64)]
    for surface in surfaces:
        mesh = int(snapshot.surface_mesh[surface])
        triangles = snapshot.triangles[slice(*snapshot.triangle_start[mesh : mesh + 2].tolist())]
        parts.append(surface_points_m(snapshot, surface)[triangles])
    return np.concatenate(parts)


def own_front(snapshot: Snapshot, index: int) -> Points | None:
    """(3,) an object's own -Y axis in the world; None where it has no surface of its own."""
    own = (snapshot.occurrence_object == index) & (snapshot.occurrence_instancer < 0)
    surfaces = np.flatnonzero(own[snapshot.surface_occurrence])
    if not len(surfaces):
        return None
    return np.asarray(-snapshot.world_from_mesh[surfaces[0]][:, 1])
