"""A .glb as a .blend, so that a reference may be one: lights, cameras and extras come along."""

from __future__ import annotations

from pathlib import Path

import bpy

from legoworld.errors import SceneInvalidError, one_line


def import_glb(glb: Path, output: Path) -> None:
    """Save a .glb as a .blend. Raises SceneInvalidError without a light: the picture is black.

    The extras of nodes and of the scene are custom properties there: `category`, `tier`, `view`.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    try:
        bpy.ops.import_scene.gltf(filepath=str(glb))
    except RuntimeError as error:
        raise SceneInvalidError(
            "Blender cannot import scene.glb", found=one_line(str(error), 200)
        ) from error
    scene = bpy.context.scene
    if not any(thing.type == "LIGHT" for thing in scene.objects):
        raise SceneInvalidError(
            "the .glb has no light, so that its picture would be black",
            found=", ".join(sorted({thing.type.lower() for thing in scene.objects})) or "nothing",
            expected="lights (KHR_lights_punctual)",
            next_step="export the lights, too, or deliver scene.blend",
        )
    cameras = sorted((o for o in scene.objects if o.type == "CAMERA"), key=lambda o: o.name)
    scene.camera = cameras[0] if cameras else None
    bpy.ops.wm.save_as_mainfile(filepath=str(output), compress=True, check_existing=False)
