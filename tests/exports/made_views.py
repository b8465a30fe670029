"""Views of plates and cubes in front of a level camera, whose numbers are known by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from readouts.level_view import LEVEL, SIZE
from scene.by_hand import RENDER, HandScene

from legoworld.exports.view import ExportedView
from legoworld.scene.blender_process import Limits
from legoworld.scene.instances import group
from legoworld.scene.labels import resolve_labels
from legoworld.visibility.view import view

PLATE = np.array([[-0.5, 0, -0.5], [0.5, 0, -0.5], [0.5, 0, 0.5], [-0.5, 0, 0.5]])
PLATE_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def made_view(
    *placed, camera=LEVEL, shape=(PLATE, PLATE_FACES), unit_scale=1.0, folder=Path(), scene="scene"
):
    """placed: (name, label or None, linear part or a factor, place) of the shape."""
    made = HandScene()
    for name, label, _, _ in placed:
        made.object(name, **({} if label is None else {"category": label}))
        made.occurs(name)
    matrices = [
        np.column_stack([np.eye(3) * linear if np.isscalar(linear) else linear, place])
        for _, _, linear, place in placed
    ]
    vertices, triangles = shape
    snapshot = replace(
        made.snapshot(),
        camera=camera,
        render=replace(RENDER, unit_scale=unit_scale),
        vertices=np.asarray(vertices, np.float32),
        triangles=triangles,
        vertex_start=np.array([0, len(vertices)]),
        triangle_start=np.array([0, len(triangles)]),
        surface_mesh=np.zeros(len(placed), np.int32),
        world_from_mesh=np.array(matrices, np.float64),
    )
    grouping = group(snapshot, resolve_labels(snapshot, (), None, None))
    return ExportedView(
        scene=scene,
        folder=folder,
        snapshot=snapshot,
        grouping=grouping,
        view=view(snapshot, grouping, SIZE),
        limits=Limits(),
    )


#: A is 1 x 1 m at 2 m, B .5 x .5 m at 1 m, moved to the right.
def two_plates(moved, **more):
    return made_view(("A", "wall", 1, (0, 2, 0)), ("B", "sheet", 0.5, (moved, 1, 0)), **more)
