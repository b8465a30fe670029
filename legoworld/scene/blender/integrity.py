"""Facts of an open .blend: images that may stand in for geometry, and joints."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np
from numpy.typing import NDArray

from legoworld.scene.blender.joints import joint_facts
from legoworld.scene.blender.open_file import open_blend

#: Images with more pixels than this have no thumbnail: 256 MiB as bytes.
_MOST_PIXELS: Final = 64 << 20


def scene_facts(
    blend: Path, thumbnail_wh: tuple[int, int]
) -> tuple[dict[str, Any], NDArray[np.uint8]]:
    """The facts of a .blend as JSON values, and its images scaled down, (N, H, W, 3) uint8.

    Every list is sorted by name. Raises what `open_blend` does.
    """
    scene = open_blend(blend).scene
    users = _image_users(scene)
    thumbnails: list[NDArray[np.uint8]] = []
    images = [
        _image(image, sorted(users.get(image.name, ())) or ["other"], thumbnails, thumbnail_wh)
        for image in sorted(bpy.data.images, key=lambda i: i.name)
        if image.source != "VIEWER"
    ]
    width, height = thumbnail_wh
    empty = np.empty((0, height, width, 3), np.uint8)
    facts = {
        "images": images,
        "world_nodes": _node_kinds(scene.world.node_tree if scene.world else None),
        "compositor_nodes": _node_kinds(compositor(scene)),
        "texts": [
            {"name": t.name, "characters": len(t.as_string()), "registers": bool(t.use_module)}
            for t in sorted(bpy.data.texts, key=lambda t: t.name)
        ],
        "drivers": _drivers(),
        "joints": joint_facts(scene),
        "images_of": _object_images(),
    }
    return facts, np.stack(thumbnails) if thumbnails else empty


def _image(
    image: bpy.types.Image,
    users: list[str],
    thumbnails: list[NDArray[np.uint8]],
    thumbnail_wh: tuple[int, int],
) -> dict[str, Any]:
    path = str(image.filepath).replace("\\", "/")
    absolute = bool(path) and not path.startswith("//")
    outside = absolute or ".." in path.split("/")
    width, height = (int(side) for side in image.size)
    small = _thumbnail(image, thumbnail_wh) if 0 < width * height <= _MOST_PIXELS else None
    if small is not None:
        thumbnails.append(small)
    return {
        "name": image.name,
        "path": Path(path).name if outside else path.removeprefix("//"),
        "size_wh": [width, height],
        "packed": image.packed_file is not None,
        "generated": image.source == "GENERATED",
        "absolute_path": absolute,
        "thumbnail": len(thumbnails) - 1 if small is not None else None,
        "users": users,
    }


def _thumbnail(image: bpy.types.Image, size_wh: tuple[int, int]) -> NDArray[np.uint8] | None:
    """(H, W, 3) uint8, top row first; None if Blender has no pixels."""
    copied = image.copy()
    try:
        copied.scale(*size_wh)
        values = np.empty(len(copied.pixels), np.float32)
        copied.pixels.foreach_get(values)
    except RuntimeError:
        return None
    finally:
        bpy.data.images.remove(copied)
    width, height = size_wh
    if values.size < width * height * 3 or values.size % (width * height):
        return None
    pixels = values.reshape(height, width, -1)[::-1, :, :3]
    return np.nan_to_num(np.clip(pixels, 0.0, 1.0) * 255.0).round().astype(np.uint8)


def _nodes(
    tree: bpy.types.NodeTree | None, seen: set[int] | None = None
) -> Iterator[bpy.types.Node]:
    """All nodes of a tree, those of its groups included, each tree once."""
    seen = set() if seen is None else seen
    if tree is None or tree.as_pointer() in seen:
        return
    seen.add(tree.as_pointer())
    for node in tree.nodes:
        yield node
        yield from _nodes(getattr(node, "node_tree", None), seen)


def _node_kinds(tree: bpy.types.NodeTree | None) -> list[str]:
    return sorted(node.bl_idname for node in _nodes(tree))


def compositor(scene: bpy.types.Scene) -> bpy.types.NodeTree | None:
    """The compositor's nodes: a group of its own since Blender 5.0."""
    if hasattr(scene, "compositing_node_group"):
        return scene.compositing_node_group
    return scene.node_tree if scene.use_nodes else None


def _images_in(tree: bpy.types.NodeTree | None) -> set[str]:
    images = (getattr(node, "image", None) for node in _nodes(tree))
    return {image.name for image in images if image is not None}


def _image_users(scene: bpy.types.Scene) -> dict[str, set[str]]:
    """What shows each image, by the image's name."""
    users: dict[str, set[str]] = {}

    def note(names: set[str], what: str) -> None:
        for name in names:
            users.setdefault(name, set()).add(what)

    for material in bpy.data.materials:
        note(_images_in(material.node_tree), "material")
    for world in bpy.data.worlds:
        note(_images_in(world.node_tree), "world")
    note(_images_in(compositor(scene)), "compositor")
    for camera in bpy.data.cameras:
        backgrounds = (background.image for background in camera.background_images)
        note({image.name for image in backgrounds if image is not None}, "camera")
    return users


def _object_images() -> dict[str, list[str]]:
    """The images that an object's materials show, for objects that show any."""
    shown = {m.name: _images_in(m.node_tree) for m in bpy.data.materials}
    images_of: dict[str, list[str]] = {}
    for thing in sorted(bpy.data.objects, key=lambda o: o.name):
        slots = (slot.material for slot in thing.material_slots)
        names = sorted(set().union(*(shown.get(m.name, set()) for m in slots if m is not None)))
        if names:
            images_of[thing.name] = names
    return images_of


def _drivers() -> int:
    kinds = ("objects", "meshes", "materials", "node_groups", "worlds", "lights", "cameras",
             "shape_keys", "armatures", "curves", "scenes")  # fmt: skip
    blocks = (block for kind in kinds for block in getattr(bpy.data, kind))
    return sum(len(b.animation_data.drivers) for b in blocks if b.animation_data is not None)
