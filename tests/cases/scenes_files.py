"""Scenes of rows 33 and 34: files that would act, and files that lack something."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy
from cases.stage import box, collection, fresh, instance_of, pixel_camera, square

_WRITES = "import pathlib; pathlib.Path({!r}).write_text('it ran')"


def _target(name: str) -> str:
    return str(Path.cwd() / name)


def registered_text() -> list[str]:
    """A text block that runs on opening, a driver, a handler, and a scripted node."""
    pixel_camera()
    made = box("Plane", 10, 10, 30, 30, category="thing")
    targets = [_target(name) for name in ("text ran", "driver ran", "handler ran")]
    text = bpy.data.texts.new("run.py")
    text.write(_WRITES.format(targets[0]))
    text.use_module = True
    driver = made.driver_add("location", 2).driver
    driver.type = "SCRIPTED"
    driver.expression = f"__import__('pathlib').Path({targets[1]!r}).write_text('it ran') * 0"
    handler = bpy.data.texts.new("handler.py")
    handler.write(
        "import bpy\ndef run(*_):\n    " + _WRITES.format(targets[2]) + "\n"
        "bpy.app.handlers.load_post.append(run)\n"
        "bpy.app.handlers.frame_change_post.append(run)\n"
        "bpy.app.handlers.render_pre.append(run)\n"
    )
    handler.use_module = True
    for target in targets:  # building may have run them
        Path(target).unlink(missing_ok=True)
    return targets


def missing_texture() -> None:
    pixel_camera()
    made = box("Plane", 10, 10, 30, 30, category="thing")
    shader = bpy.data.materials.new("textured")
    texture = shader.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("bark", 4, 4)
    texture.image.source, texture.image.filepath = "FILE", "//textures/bark.png"
    principled = shader.node_tree.nodes["Principled BSDF"]
    shader.node_tree.links.new(texture.outputs["Color"], principled.inputs["Base Color"])
    made.data.materials.append(shader)


def _library(name: str, side: float, nested: str | None = None) -> None:
    """Save a library with a labelled stool beside the scenes."""
    fresh()
    stool = collection("Stool", category="chair")
    square("Seat", side, stool)
    if nested:
        _link(nested, stool)
    bpy.ops.wm.save_as_mainfile(filepath=_target(name), check_existing=False)
    fresh()


def _link(name: str, target: Any = None) -> None:
    with bpy.data.libraries.load(_target(name), link=True) as (_, wanted):
        wanted.collections = ["Stool"]
    instance_of(wanted.collections[0], f"Stool of {name}", 40, 30, target)


def linked_library() -> None:
    _library("stool.blend", 10)
    pixel_camera()
    _link("stool.blend")


def lost_library() -> None:
    _library("lost.blend", 10)
    pixel_camera()
    square("Local", 5)
    _link("lost.blend")
    os.remove(_target("lost.blend"))  # noqa: PTH107


def lost_nested_library() -> None:
    _library("inner.blend", 10)
    _library("outer.blend", 20, nested="inner.blend")
    pixel_camera()
    square("Local", 5)
    _link("outer.blend")
    os.remove(_target("inner.blend"))  # noqa: PTH107
