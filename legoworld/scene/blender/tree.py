"""The object tree: objects and collections in a canonical order, with their labels."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from legoworld.conventions import CATEGORY_KEY
from legoworld.scene.blender.objects import ancestors, identity
from legoworld.scene.blender.placements import Identity
from legoworld.scene.snapshot import SceneCollection, SceneObject


def scene_tree(
    scene: bpy.types.Scene, visited: set[Identity], warnings: set[str]
) -> tuple[tuple[SceneObject, ...], tuple[SceneCollection, ...], dict[Identity, int]]:
    """Objects and collections sorted by (name, library), and each object's index.

    Objects are the scene's own, those in `visited`, and all their parents.
    """
    blocks = {identity(o): o for o in bpy.data.objects}
    wanted = visited | {identity(o) for o in scene.objects}
    for key in list(wanted):
        wanted.update(identity(parent) for parent in ancestors(blocks[key]))
    keys = sorted(wanted)
    index = {key: i for i, key in enumerate(keys)}
    collections, holders = _collections(index, warnings)
    objects = tuple(
        SceneObject(
            name=key[0],
            library=key[1] or None,
            type=blocks[key].type,
            parent=index[identity(blocks[key].parent)] if blocks[key].parent else -1,
            collections=tuple(holders.get(key, ())),
            instance_type=blocks[key].instance_type,
            properties=_labels(blocks[key], warnings),
        )
        for key in keys
    )
    return objects, collections, index


def _collections(
    object_index: Mapping[Identity, int], warnings: set[str]
) -> tuple[tuple[SceneCollection, ...], dict[Identity, list[int]]]:
    """All collections of the file, and by object those that hold it directly."""
    folders = {identity(c): c for c in bpy.data.collections}
    keys = sorted(folders)
    index = {key: i for i, key in enumerate(keys)}
    holders: dict[Identity, list[int]] = {}
    parents: dict[Identity, list[int]] = {key: [] for key in keys}
    for key in keys:
        for member in folders[key].objects:
            if identity(member) in object_index:
                holders.setdefault(identity(member), []).append(index[key])
        for child in folders[key].children:
            parents[identity(child)].append(index[key])
    collections = tuple(
        SceneCollection(
            name=key[0],
            library=key[1] or None,
            parents=tuple(parents[key]),
            properties=_labels(folders[key], warnings),
        )
        for key in keys
    )
    return collections, holders


def _labels(block: bpy.types.ID, warnings: set[str]) -> dict[str, str]:
    """The custom properties that are labels; numbers are kept as their text."""
    labels = {}
    for key in sorted(block.keys()):
        if key != CATEGORY_KEY and not key.endswith("_" + CATEGORY_KEY):
            continue
        value = block[key]
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, str | int | float):
            labels[key] = str(value)
        else:
            warnings.add(f"{block.name!r} has a property {key!r} that is not text: not a label")
    return labels
