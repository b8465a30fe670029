"""Boxes before a level camera at the origin, placed in its own frame: all facts are known."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from scene.by_hand import CAMERA, RENDER, HandScene

from legoworld.scene.instances import Grouping, Instance
from legoworld.tracks.vocabulary import Category
from legoworld.visibility.view import view

#: World axes: x as the camera's, y its depth, z up.
LEVEL = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, -1.0, 0.0, 0.0))
CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)), np.float32)
FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
     (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)], np.int32
)  # fmt: skip
SIZE = (320, 240)


def view_of(*placed, unit_scale=1.0, size=SIZE, camera=None, faces=FACES):
    """placed: (category, camera-frame middle, size or 3 of them, degrees about up, optional).

    faces: of each box.

    Returns the view and its instances; a category of None is unlabelled.
    """
    scene = HandScene()
    matrices = []
    for n, (_, middle, side, *turn) in enumerate(placed):
        name = f"thing {n}"
        scene.object(name)
        scene.occurs(name)
        a = np.radians(turn[0] if turn else 0.0)
        about_up = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        x, y, z = middle
        linear = about_up @ np.diag(np.broadcast_to(np.asarray(side, float), 3))
        matrices.append(np.column_stack([linear, [x, z, -y]]) / unit_scale)
    n = len(placed)
    snapshot = replace(
        scene.snapshot(),
        camera=replace(camera or CAMERA, world_from_camera=LEVEL, lens_mm=24.0, clip_end=1e4),
        render=replace(RENDER, unit_scale=unit_scale),
        vertices=CORNERS,
        triangles=faces,
        vertex_start=np.array([0, 8]),
        triangle_start=np.array([0, len(faces)]),
        surface_mesh=np.zeros(n, np.int32),
        world_from_mesh=np.array(matrices).reshape(n, 3, 4),
    )
    numbers = {kind: k for k, kind in enumerate(dict.fromkeys(p[0] for p in placed if p[0]), 1)}
    instances = tuple(
        Instance(
            id=i,
            name=f"thing {i}",
            objects=(f"thing {i}",),
            category=Category(id=numbers[kind], name=kind) if kind else None,
            label_text=kind,
        )
        for i, (kind, *_) in enumerate(placed)
    )
    grouping = Grouping(
        instances=instances,
        surface_instance=np.arange(n, dtype=np.int32),
        enclosing_instance={},
        outside_vocabulary={},
        unseen_owners=(),
        warnings=(),
    )
    return view(snapshot, grouping, size), instances
