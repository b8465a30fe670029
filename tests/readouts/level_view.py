"""Views of one mesh placed in front of a level camera: every box is known by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scene.by_hand import CAMERA, RENDER, HandScene

from legoworld.visibility.view import view

#: Level, at the origin: the picture's right is world x, its depth is world y.
LEVEL = replace(
    CAMERA,
    world_from_camera=((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0, 0.0)),
)
CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]], np.int32,
)  # fmt: skip
SIZE = (100, 100)


def about_z(degrees):
    a = np.radians(degrees)
    return np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])


def look(*placed, camera=LEVEL, unit_scale=1.0, triangles=FACES, vertices=CUBE):
    """A view of one mesh placed by (linear part, place) each; each placement is an instance."""
    scene = HandScene()
    for k in range(len(placed)):
        scene.object(str(k))
        scene.occurs(str(k))
    matrices = [np.column_stack([linear, place]) for linear, place in placed]
    snapshot = replace(
        scene.snapshot(),
        camera=camera,
        render=replace(RENDER, unit_scale=unit_scale),
        vertices=np.asarray(vertices, np.float32),
        triangles=triangles,
        vertex_start=np.array([0, len(vertices)]),
        triangle_start=np.array([0, len(triangles)]),
        surface_mesh=np.zeros(len(placed), np.int32),
        world_from_mesh=np.array(matrices, np.float64),
    )
    return view(snapshot, scene.grouped(), SIZE)
