"""Does `colour` name what has another colour, and only that? Random rooms, rendered by Cycles.

    python benchmarks/plugin/colours.py [--rooms 100]

Each room's photo is a render of 48 samples, saved as JPEG. The scene is rendered as the plugin does
(16 samples, no denoising), once under the photo's light and once under another: lamps and world at
.7 to 1.4 of their strength, the world's red and blue at .85 to 1.15 of it. Planted is one object a
room whose base colour is another by 20 or more (CIE 1976); the others are innocent.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import bpy
import cv2
import mathutils
import numpy as np
import planted
from planted import F64, Pose, Thing, camera, cast, corners, place_things
from touching import _FACES, box

from legoworld.plugin.small_render import mean_lab
from legoworld.records.plugin_requirements import Colour

SEEN_PX = 60
Light = tuple[F64, F64]  # watts of two lamps, RGB of the world
FLOOR = box(np.array([-9.0, -9.0, -0.1]), np.array([9.0, 9.0, 0.0]))


def render(things: dict[str, Thing], colours: dict[str, F64], light: Light, pose: Pose,
           samples: int, path: Path) -> Any:  # fmt: skip
    """(H, W, 3) RGB of a room, written to a path and read back."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", samples, False
    scene.render.resolution_x, scene.render.resolution_y = planted.WH
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (*light[1], 1)
    solids = {name: corners(thing) for name, thing in things.items()} | {"floor": FLOOR}
    for name, points in solids.items():
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(points.tolist(), [], np.asarray(_FACES).tolist())
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        shader = material.node_tree.nodes["Principled BSDF"]
        shader.inputs["Base Color"].default_value = (*colours.get(name, (0.5, 0.45, 0.4)), 1)
        shader.inputs["Roughness"].default_value = 0.7
        mesh.materials.append(material)
        scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    for watts, place in zip(light[0], ((-2, -3, 3.5), (2.5, 0, 4)), strict=True):
        lamp = bpy.data.lights.new("lamp", "AREA")
        lamp.energy = watts
        held = bpy.data.objects.new("lamp", lamp)
        held.location = place
        scene.collection.objects.link(held)
    eye = bpy.data.cameras.new("camera")
    eye.sensor_width = eye.lens = 36
    scene.camera = bpy.data.objects.new("camera", eye)
    scene.collection.objects.link(scene.camera)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose[0] @ np.diag([1, -1, -1]), pose[1]
    scene.camera.matrix_world = mathutils.Matrix(matrix.tolist())
    jpeg = path.suffix == ".jpg"
    scene.render.image_settings.file_format = "JPEG" if jpeg else "PNG"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    picture = cv2.imread(str(path))
    assert picture is not None
    return np.ascontiguousarray(picture[:, :, ::-1])


def as_rgb8(linear: F64) -> Any:
    """(1, 3) sRGB of a linear colour."""
    low = linear <= 0.0031308
    return np.rint(255 * np.where(low, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055))[None]


def main() -> None:
    """Print the counts under the photo's light and under another."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rooms", type=int, default=100)
    rooms, random = parser.parse_args().rooms, np.random.default_rng(7)
    tolerance = Colour(entity="", region="").tolerance
    found: dict[str, tuple[list[float], list[float]]] = {"same": ([], []), "other": ([], [])}
    with tempfile.TemporaryDirectory() as name:
        while len(found["same"][0]) < rooms:
            rotation, place = camera(random)
            pose, things = (rotation, place - [0, 1.5, 0]), place_things(random, 8)
            depths = cast([*things.values()], pose)
            shown = np.where(np.isfinite(depths.min(axis=0)), depths.argmin(axis=0), -1)
            seen = [k for k in range(len(things)) if (shown == k).sum() >= SEEN_PX]
            if not seen:
                continue
            colours = {name: random.uniform(0.05, 0.9, 3) for name in things}
            false, wrong = int(random.choice(seen)), dict(colours)
            changed = [*things][false]
            before = mean_lab(as_rgb8(colours[changed]))
            while np.linalg.norm(mean_lab(as_rgb8(wrong[changed])) - before) < 20:
                wrong[changed] = random.uniform(0.05, 0.9, 3)
            world = np.full(3, 0.3)
            lights = {"same": (np.array([150.0, 120.0]), world)}
            tint = np.array([random.uniform(0.85, 1.15), 1, random.uniform(0.85, 1.15)])
            lights["other"] = (
                lights["same"][0] * random.uniform(0.7, 1.4, 2),
                world * random.uniform(0.7, 1.4) * tint,
            )
            photo = render(things, colours, lights["same"], pose, 48, Path(name, "photo.jpg"))
            for which, light in lights.items():
                ours = render(things, wrong, light, pose, 16, Path(name, "scene.png"))
                for k in seen:
                    pixels = shown == k
                    off = np.linalg.norm(mean_lab(ours[pixels]) - mean_lab(photo[pixels]))
                    found[which][k != false].append(float(off))
    for which, (planted_off, innocent_off) in found.items():
        named = [off > tolerance for off in planted_off]
        accused = [off > tolerance for off in innocent_off]
        middle, most = np.quantile(innocent_off, [0.5, 1])
        print(f"{which} light: {planted.count_fails(named, accused)}; planted off by "
              f"{min(planted_off):.1f} or more, innocent by {middle:.1f} at the median and "
              f"{most:.1f} at most")  # fmt: skip


if __name__ == "__main__":
    main()
