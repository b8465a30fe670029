"""Strands as ribbons that face the camera: how Cycles draws hair by default."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.hair.strands import Eye, Nodes, Strands, nodes, side

Triangulated = tuple[NDArray[np.float32], NDArray[np.int32]]
"""(V, 3) float32 vertices and (T, 3) int32 triangles."""

#: A ribbon wider than this share of its distance shows that it turns towards each ray.
_FLAT: Final = 3e-3
_FINEST: Final = 16


def ribbons(strands: Strands, eye: Eye, per_segment: int) -> Triangulated:
    """The mesh of all strands, (V, 3) and (T, 3), in their frame.

    per_segment: the quads Embree divides a strand into between two keys
    (RTC_GEOMETRY_TYPE_FLAT_CATMULL_ROM_CURVE). It turns each quad towards the ray that hits it;
    wide quads are subdivided so that all rays hit the same surface.
    """
    share = float(eye.share(strands.points, strands.radius).max(initial=0.0))
    fine = min(_FINEST, max(1, math.ceil(min(share, 1.0) / _FLAT)))
    if fine == 1:
        return join_meshes(
            [_narrow(nodes(part, eye, per_segment, True), eye) for part in strands.parts()]
        )
    return join_meshes(
        [_band(nodes(part, eye, per_segment, False), eye, fine) for part in strands.parts()]
    )


def join_meshes(parts: list[Triangulated]) -> Triangulated:
    """Several meshes, (V, 3) and (T, 3) each, as one."""
    first = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    return (
        np.concatenate([vertices for vertices, _ in parts] or [np.empty((0, 3), np.float32)]),
        np.concatenate(
            [t + np.int32(n) for (_, t), n in zip(parts, first[:-1].tolist(), strict=True)]
            or [np.empty((0, 3), np.int32)]
        ),
    )


def _narrow(along: Nodes, eye: Eye) -> Triangulated:
    """Ribbons narrow enough that the ray to the strand approximates the rays to their edges."""
    across = side(along.tangent, eye.toward(along.points)) * along.radius[:, None]
    vertices = np.empty((len(along.points), 2, 3), np.float32)
    vertices[:, 0], vertices[:, 1] = along.points + across, along.points - across
    a = 2 * along.pairs
    return vertices.reshape(-1, 3), quads(a, a + 1, a + 2, a + 3)


def _band(along: Nodes, eye: Eye, fine: int) -> Triangulated:
    """Each quad divided `fine` times along and across; a strand's last node closes it."""
    is_row = np.ones((len(along.last), fine), bool)
    is_row[along.last, 1:] = False
    here, step = np.nonzero(is_row)
    after = np.where(along.last[here], here, here + 1)
    rows = [
        _on_quads(along, here, after, step / fine, np.full(len(here), column / fine), eye)
        for column in range(fine + 1)
    ]
    vertices = np.stack(rows, axis=1).reshape(-1, 3).astype(np.float32)
    a = np.flatnonzero(~along.last[here])[:, None] * (fine + 1) + np.arange(fine)
    return vertices, quads(a, a + 1, a + fine + 1, a + fine + 2)


def _on_quads(
    along: Nodes,
    here: NDArray[np.int64],
    after: NDArray[np.int64],
    u: NDArray[np.float64],
    v: NDArray[np.float64],
    eye: Eye,
) -> NDArray[np.float64]:
    """(N, 3) points of quads at (u, v), along and across, where the ray there hits them.

    The quad between two nodes has its corners left and right of both, square to the ray; it
    consists of two triangles. Four iterations find the ray that hits the point.
    """
    u, v = u[:, None], v[:, None]
    point = along.points[here] * (1.0 - u) + along.points[after] * u
    for _ in range(4):
        ray = eye.toward(point)
        offset = [side(along.tangent[n], ray) * along.radius[n][:, None] for n in (here, after)]
        left, right = along.points[here] + offset[0], along.points[here] - offset[0]
        left_1, right_1 = along.points[after] + offset[1], along.points[after] - offset[1]
        first = left + u * (left_1 - left) + v * (right - left)
        second = right_1 + (1.0 - u) * (right - right_1) + (1.0 - v) * (left_1 - right_1)
        point = np.where(u + v <= 1.0, first, second)
    return np.asarray(point)


def quads(
    left: NDArray[np.int64],
    right: NDArray[np.int64],
    next_left: NDArray[np.int64],
    next_right: NDArray[np.int64],
) -> NDArray[np.int32]:
    """(2 N, 3) int32 triangles of N quads, divided as Embree divides a ribbon's."""
    one = np.stack([left, next_left, right], axis=-1)
    other = np.stack([next_right, right, next_left], axis=-1)
    return np.stack([one, other], axis=-2).reshape(-1, 3).astype(np.int32)
