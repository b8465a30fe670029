"""Snapshots of upright squares in front of a camera: all a surface's numbers are known by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scene.by_hand import CAMERA, RENDER, HandScene

from legoworld.scene.snapshot import Snapshot

#: A square of side 2 around its middle, in the plane z = 0.
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
#: The same with a middle that stands out by a tenth: no plane.
BUMP = np.array([*SQUARE, [0, 0, 0.3]], np.float32)


_UPRIGHT = np.eye(3)


def rotation(degrees: float) -> np.ndarray:
    """About the vertical axis."""
    a = np.radians(degrees)
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def quads(*placed: tuple[str, ArrayLike, ArrayLike], camera=CAMERA, unit_scale=1.0) -> Snapshot:
    """placed: object name, vertices of four corners (and a middle), (3, 4) world_from_mesh.

    The camera stands at z = 10 and looks along -z.
    """
    scene = HandScene()
    for name, _, _ in placed:
        scene.object(name)
        scene.occurs(name)
    vertices = [np.asarray(v, np.float32) for _, v, _ in placed]
    triangles = [
        np.array([[0, 1, 2], [0, 2, 3]] + ([[0, 1, 4]] if len(v) > 4 else []), np.int32)
        for v in vertices
    ]
    return replace(
        scene.snapshot(),
        camera=camera,
        render=replace(RENDER, unit_scale=unit_scale),
        vertices=np.concatenate(vertices),
        triangles=np.concatenate(triangles),
        vertex_start=np.cumsum([0, *map(len, vertices)]),
        triangle_start=np.cumsum([0, *map(len, triangles)]),
        surface_mesh=np.arange(len(placed), dtype=np.int32),
        world_from_mesh=np.array([np.asarray(m, np.float64) for _, _, m in placed]),
    )


def at(x: float, y: float, z: float, linear: ArrayLike = _UPRIGHT) -> np.ndarray:
    """(3, 4): a linear part and a place."""
    return np.column_stack([np.asarray(linear, np.float64), [x, y, z]])
