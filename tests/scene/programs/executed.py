"""Scene programs for `legoworld execute`, and what it left."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

from legoworld import cli

BUILD = """
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_cube_add(size=2)
bpy.context.object["category"] = "dog"
bpy.context.object.data.materials.append(bpy.data.materials.new("Grey"))
camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
camera.location.z = 8
bpy.context.scene.collection.objects.link(camera)
bpy.context.scene.camera = camera
bpy.context.scene.render.resolution_x = 48
bpy.context.scene.render.resolution_y = 32
light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "SUN"))
bpy.context.scene.collection.objects.link(light)
"""


def execute(tmp_path: Path, program: str, *options: str, quiet: bool = True) -> tuple[int, Path]:
    path = tmp_path / "program.py"
    path.write_text(textwrap.dedent(program))
    output = tmp_path / "scene"
    return cli.run(["execute", str(path), "-o", str(output), *["-q"] * quiet, *options]), output


def execution(output: Path) -> dict:
    return json.loads((output / "execution.json").read_text())
