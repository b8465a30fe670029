"""Points of point clouds as spheres, tessellated by their size in the view."""

from __future__ import annotations

import math
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.affine import cross, dot, unit
from legoworld.scene.hair.ribbons import Triangulated
from legoworld.scene.hair.strands import TOLERANCE

#: Twenty triangles, and four times as many with every level.
_MOST_LEVELS: Final = 6


@cache
def sphere(level: int) -> Triangulated:
    """(V, 3), (T, 3) of an icosphere: its corners as far outside radius 1 as its faces inside."""
    vertices, triangles = _subdivide(level)
    corners = vertices[triangles]
    normals = unit(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    inner = float(np.abs(dot(normals, corners[:, 0])).min())
    return (vertices * (2.0 / (1.0 + inner))).astype(np.float32), triangles


@cache
def sphere_error(level: int) -> float:
    """The largest deviation of a level's sphere from radius 1."""
    vertices, _ = sphere(level)
    return float(np.sqrt(dot(*[vertices.astype(np.float64)] * 2)).max()) - 1.0


def sphere_levels(share: NDArray[np.float64]) -> NDArray[np.int64]:
    """(P,) the coarsest level that deviates by at most `TOLERANCE` of the distance, up to 6.

    share: (P,) radius / distance.
    """
    limits = [TOLERANCE / sphere_error(level) for level in range(_MOST_LEVELS)]
    return np.searchsorted(limits, share, side="left").astype(np.int64)


def _subdivide(level: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    if level == 0:
        return _icosahedron()
    vertices, triangles = _subdivide(level - 1)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, place = np.unique(edges, axis=0, return_inverse=True)
    middle = (place.reshape(-1, 3) + len(vertices)).astype(np.int32)
    between = unit(vertices[unique[:, 0]] + vertices[unique[:, 1]])
    (a, b, c), (ab, bc, ca) = triangles.T, middle.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([vertices, between]), np.concatenate([np.stack(p, axis=1) for p in parts])


def _icosahedron() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    flat = [(a, b * golden) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    corners = [np.roll((0.0, *pair), shift) for shift in range(3) for pair in flat]
    vertices = unit(np.array(corners, np.float64))
    gap = vertices[:, None] - vertices[None]
    near = dot(gap, gap) < 1.2  # an edge's square is 1.106, the next distance's 2.894
    triangles = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    return vertices, np.array(triangles, np.int32)
