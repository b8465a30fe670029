"""USD and glTF by Blender's own exporter and importers."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from legoworld.errors import SceneInvalidError, one_line
from legoworld.scene.blender.open_file import open_blend
from legoworld.scene.blender.reference_cases import show_scene


def export_usd(blend: Path, output: Path) -> None:
    """Write what a .blend renders as USD; names of objects are kept as Blender has them."""
    scene = open_blend(blend).scene
    show_scene(scene)
    bpy.ops.wm.usd_export(
        filepath=str(output),
        evaluation_mode="RENDER",
        xform_op_mode="MAT",  # translation, rotation and scale cannot hold shear
        export_subdivision="TESSELLATE",  # as it is rendered, not for a reader to subdivide
        use_instancing=False,  # a label is a prim's, and each placement has its own
        author_blender_name=True,
        export_textures_mode="NEW",
        overwrite_textures=True,
        relative_paths=True,
    )


def import_usd(
    layer: Path, output: Path, properties: tuple[str, str], metres_per_unit: float
) -> None:
    """Save a USD file as a .blend. properties: those of a category and of an instance.

    Objects of one instance are put into a collection that has its category. SceneInvalidError for a
    file Blender cannot import.
    """
    category, instance = properties
    with _new_scene("the USD file"):
        bpy.ops.wm.usd_import(
            filepath=str(layer),
            import_textures_mode="IMPORT_PACK",
            apply_unit_conversion_scale=False,  # it scales cameras and not all objects
        )
    parts: dict[str, list[Any]] = defaultdict(list)
    scene = bpy.context.scene
    scene.unit_settings.scale_length = metres_per_unit
    for shown in scene.objects:
        for key in properties:  # a mesh that was merged with its parent keeps its own
            if shown.data is not None and key in shown.data and key not in shown:
                shown[key] = shown.data[key]
        if category in shown and instance in shown:
            parts[shown[instance]].append(shown)
    for name, objects in parts.items():
        if len(objects) > 1:
            whole = bpy.data.collections.new(name)
            scene.collection.children.link(whole)
            whole[category] = objects[0][category]
            for shown in objects:
                whole.objects.link(shown)
                del shown[category]
    _save(output)


def import_glb(glb: Path, output: Path) -> None:
    """Save a .glb as a .blend, so that a reference may be one.

    Lights, cameras and extras come along: the extras of nodes and of the scene are custom
    properties (`category`, `tier`, `view`). Raises SceneInvalidError without a light, which would
    give a black picture.
    """
    with _new_scene("scene.glb"):
        bpy.ops.import_scene.gltf(filepath=str(glb))
    scene = bpy.context.scene
    if not any(thing.type == "LIGHT" for thing in scene.objects):
        raise SceneInvalidError(
            "the .glb has no light, so that its picture would be black",
            found=", ".join(sorted({thing.type.lower() for thing in scene.objects})) or "nothing",
            expected="lights (KHR_lights_punctual)",
            next_step="export the lights, too, or deliver scene.blend",
        )
    _save(output)


@contextmanager
def _new_scene(what: str) -> Iterator[None]:
    """An empty file that the block imports into; SceneInvalidError where Blender refuses to."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    try:
        yield
    except RuntimeError as error:
        raise SceneInvalidError(
            f"Blender cannot import {what}",
            found=one_line(str(error), 200),
            expected="a file that Blender's own importer reads",
            next_step="export it again, or deliver scene.blend",
        ) from error


def _save(output: Path) -> None:
    """Save the open file; its camera is the first by name."""
    scene = bpy.context.scene
    cameras = sorted((o for o in scene.objects if o.type == "CAMERA"), key=lambda o: o.name)
    scene.camera = cameras[0] if cameras else None
    bpy.ops.wm.save_as_mainfile(filepath=str(output), compress=True, check_existing=False)
