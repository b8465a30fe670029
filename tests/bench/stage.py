"""The stage that the bench's scenes are built on, and a picture that is one."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

PROGRAM = """
def box(name, x, y, z, half, **properties):
    s = [(a, b, c) for c in (0, 1) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    at = [(x + half * a, y + half * b, z + 2 * half * c) for a, b, c in s]
    faces = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    return mesh(name, at, faces, **properties)

def stage(lens=30.0):
    import math
    scene = fresh()
    scene.render.resolution_x, scene.render.resolution_y = 64, 36
    scene.unit_settings.scale_length = 1.0
    world = bpy.data.worlds.new("World")
    scene.world = world
    quad("Floor", half=8.0)
    box("Red", -1.0, 0.0, 0.0, 0.5, category="box")
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler = (0.6, 0.2, 0.0)
    sun.data.energy = 3.0
    scene.collection.objects.link(sun)
    made = camera(lens=lens)
    made.location = (0.0, -6.0, 3.0)
    made.rotation_euler = (math.radians(68), 0.0, 0.0)
    return scene

def deliver(name):
    save(name)
    bpy.ops.export_scene.gltf(filepath=str(OUT / name / "scene.glb"), export_cameras=True)
"""


def picture(path: Path) -> None:
    values = np.arange(36 * 64 * 3, dtype=np.uint32).reshape(36, 64, 3) % 251
    cv2.imwrite(str(path), values.astype(np.uint8))
