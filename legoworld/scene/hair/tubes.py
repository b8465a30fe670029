"""Strands as tubes: how Cycles draws thick hair, round along a spline or along straight pieces."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.affine import cross, dot, length, unit
from legoworld.scene.hair.ribbons import Triangulated, join_meshes, quads
from legoworld.scene.hair.spheres import sphere, sphere_levels
from legoworld.scene.hair.strands import TOLERANCE, Eye, Nodes, Strands, nodes

_FEWEST_SIDES: Final = 4
_MOST_SIDES: Final = 64
_MOST_STEPS: Final = 16


def round_tubes(strands: Strands, eye: Eye) -> Triangulated:
    """(V, 3), (T, 3): discs swept along the spline, perpendicular to it; open at both ends."""
    sides, steps = _sides(strands, eye), _steps(strands, eye)
    parts = []
    for part in strands.parts():
        along = nodes(part, eye, steps, True)
        across = _carried_along(along)
        rings = _rings(along.points, along.tangent, across, along.radius, sides)
        parts.append((rings.reshape(-1, 3).astype(np.float32), _ring_triangles(along.pairs, sides)))
    return join_meshes(parts)


def linear_tubes(strands: Strands, eye: Eye) -> Triangulated:
    """Vertices (V, 3), triangles (T, 3): a sphere at each key and cones tangent to them."""
    sides = _sides(strands, eye)
    share = float(eye.share(strands.points, strands.radius).max(initial=0.0))
    ball = sphere(int(sphere_levels(np.array([share]))[0]))
    parts = []
    for part in strands.parts():
        parts += [_cones(part, sides), _balls(part, ball)]
    return join_meshes(parts)


def _cones(strands: Strands, sides: int) -> Triangulated:
    is_last = np.zeros(len(strands.points), bool)
    is_last[strands.start[1:] - 1] = True
    first = np.flatnonzero(~is_last)
    way = strands.points[first + 1] - strands.points[first]
    size = length(way)
    narrowing = strands.radius[first] - strands.radius[first + 1]
    apart = np.abs(narrowing) < size  # otherwise one sphere holds the other
    first, way, size, narrowing = first[apart], way[apart], size[apart], narrowing[apart]
    axis, sine = way / size[:, None], narrowing / size
    cosine = np.sqrt(1.0 - sine * sine)
    across = _any_across(axis)
    rings = []
    for key in (first, first + 1):
        radius = strands.radius[key]
        centre = strands.points[key] + axis * (radius * sine)[:, None]
        rings.append(_rings(centre, axis, across, radius * cosine, sides))
    vertices = np.stack(rings, axis=1).reshape(-1, 3).astype(np.float32)
    return vertices, _ring_triangles(2 * np.arange(len(first)), sides)


def _balls(strands: Strands, ball: Triangulated) -> Triangulated:
    vertices, triangles = ball
    placed = strands.points[:, None] + strands.radius[:, None, None] * vertices
    first = np.arange(len(strands.points))[:, None, None] * len(vertices)
    return placed.reshape(-1, 3).astype(np.float32), (triangles + first).reshape(-1, 3).astype(
        np.int32
    )


def _rings(
    centre: NDArray[np.float64],
    axis: NDArray[np.float64],
    across: NDArray[np.float64],
    radius: NDArray[np.float64],
    sides: int,
) -> NDArray[np.float64]:
    """(N, sides, 3): polygons with corners as far outside a circle as their sides are inside."""
    other = cross(axis, across)
    radius = radius * (2.0 / (1.0 + math.cos(math.pi / sides)))
    corners = [
        centre
        + (math.cos(turn) * radius)[:, None] * across
        + (math.sin(turn) * radius)[:, None] * other
        for turn in (2.0 * math.pi * i / sides for i in range(sides))
    ]
    return np.stack(corners, axis=1)


def _ring_triangles(rings: NDArray[np.int64], sides: int) -> NDArray[np.int32]:
    """Triangles between each of these rings and the next one."""
    here = np.arange(sides)
    beside = (here + 1) % sides
    low, high = rings[:, None] * sides, (rings[:, None] + 1) * sides
    return quads(low + here, low + beside, high + here, high + beside)


def _carried_along(along: Nodes) -> NDArray[np.float64]:
    """(N, 3) unit vectors perpendicular to the tangents, with minimal rotation."""
    across = _any_across(along.tangent)
    first = np.flatnonzero(np.concatenate([[True], along.last[:-1]]))
    count = np.diff(np.append(first, len(along.last)))
    for step in range(1, int(count.max(initial=1))):
        here = first[count > step] + step
        before, tangent = across[here - 1], along.tangent[here]
        carried = before - tangent * dot(before, tangent)[:, None]
        turned = length(carried) > 1e-6
        across[here[turned]] = unit(carried[turned])
    return across


def _any_across(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) unit vectors perpendicular to unit vectors."""
    smallest = np.abs(axis).argmin(axis=1)
    return unit(cross(axis, np.eye(3)[smallest]))


def _sides(strands: Strands, eye: Eye) -> int:
    """The number of sides that keeps a ring's error below `TOLERANCE` of its distance."""
    share = float(eye.share(strands.points, strands.radius).max(initial=0.0))
    if share <= TOLERANCE:
        return _FEWEST_SIDES
    turn = max(math.pi / _MOST_SIDES, math.acos(1.0 - 2.0 * TOLERANCE / share))
    return max(_FEWEST_SIDES, math.ceil(math.pi / turn))


def _steps(strands: Strands, eye: Eye) -> int:
    """The number of steps between two keys that keeps the spline's error below `TOLERANCE`.

    A spline's chord over 1 / n of a segment deviates from it by at most its second derivative over
    8 n^2; a Catmull-Rom segment's is at its ends at most twice the keys' second difference.
    """
    points = strands.points
    if len(points) < 3:
        return 1
    bend = points[2:] - 2.0 * points[1:-1] + points[:-2]
    inside = np.ones(len(points), bool)
    inside[strands.start[1:] - 1] = inside[strands.start[:-1]] = False
    bend = bend[inside[1:-1]]
    share = eye.share(points[1:-1][inside[1:-1]], 4.0 * length(bend))
    needed = math.sqrt(min(float(share.max(initial=0.0)), 1.0) / (8.0 * TOLERANCE))
    return min(_MOST_STEPS, max(1, math.ceil(needed)))
