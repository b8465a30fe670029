"""Builds the scenes of the throughput benchmark: `python build.py FOLDER COUNT LOW HIGH SEED`.

Rooms of labelled things: 5 to 40 objects of spheres, subdivided boxes, tubes and a floor, LOW to
HIGH triangles in all (log-uniform), some of them parts below an empty, some with a modifier.
"""

from __future__ import annotations

import math
import random
import sys
from pathlib import Path
from typing import Any

import bpy

SIZE_WH = (640, 480)
CATEGORIES = ("sports ball", "chair", "bottle", "dog", "car", "person", "cup", "book")


def main() -> int:
    """Build and save; see the module's docstring."""
    folder, count = Path(sys.argv[1]), int(sys.argv[2])
    low, high, seed = int(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5])
    for number in range(count):
        chance = random.Random(seed * 100_003 + number)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        triangles = math.exp(chance.uniform(math.log(low), math.log(high)))
        room(bpy.context.scene, chance, triangles)
        scene = folder / f"{number:012d}"
        scene.mkdir(parents=True)
        bpy.ops.wm.save_as_mainfile(filepath=str(scene / "scene.blend"), check_existing=False)
    return 0


def room(scene: Any, chance: random.Random, triangles: float) -> None:
    """A camera, a floor and things that have `triangles` together."""
    scene.render.resolution_x, scene.render.resolution_y = SIZE_WH
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -14.0, 6.0), (math.radians(70), 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    bpy.ops.mesh.primitive_plane_add(size=60)
    n_things = chance.randint(5, 40)
    share = triangles / n_things
    for number in range(n_things):
        place = (chance.uniform(-7, 7), chance.uniform(-5, 12), chance.uniform(0.3, 2.5))
        made = thing(chance, share, place)
        made.name = f"Thing {number}"
        if number % 3:
            made["category"] = chance.choice(CATEGORIES)
            continue
        whole = bpy.data.objects.new(f"Whole {number}", None)
        whole["category"] = chance.choice(CATEGORIES)
        scene.collection.objects.link(whole)
        made.parent = whole


def thing(chance: random.Random, triangles: float, place: tuple[float, float, float]) -> Any:
    """One object of about so many triangles."""
    kind, radius = chance.randrange(3), chance.uniform(0.3, 1.1)
    side = max(3, round(math.sqrt(triangles / 2)))
    if kind == 0:
        bpy.ops.mesh.primitive_uv_sphere_add(
            segments=side, ring_count=max(3, side), radius=radius, location=place
        )
    elif kind == 1:
        levels = max(0, round(math.log(max(triangles, 12) / 12, 4)))
        bpy.ops.mesh.primitive_cube_add(size=radius * 1.6, location=place)
        modifier = bpy.context.object.modifiers.new("Subdivision", "SUBSURF")
        modifier.levels, modifier.render_levels = 0, levels
    else:
        bpy.ops.mesh.primitive_torus_add(
            major_segments=side, minor_segments=side, major_radius=radius, minor_radius=radius / 3,
            location=place,
        )  # fmt: skip
    made = bpy.context.object
    made.rotation_euler = [chance.uniform(0, math.tau) for _ in range(3)]
    return made


if __name__ == "__main__":
    sys.exit(main())
