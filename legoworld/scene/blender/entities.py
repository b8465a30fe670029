"""Every object of the open file with hashes of its settings: what a transaction compares."""

from __future__ import annotations

from typing import Any, Final

import bpy

from legoworld.files import canonical_json, sha256_of_text
from legoworld.records.plugin_state import EntityState
from legoworld.scene.blender.integrity import compositor
from legoworld.scene.blender.settings import CUSTOM, Settings

#: An object's settings that say where it is seen; all others are its data.
_VISIBILITY: Final = ("hide_", "visible_", "is_holdout", "is_shadow_catcher", "instance_", "cycles",
                      "light_linking", "show_instancer", "use_instance")  # fmt: skip


def scene_states(scene: bpy.types.Scene) -> tuple[list[EntityState], dict[str, str]]:
    """The file's objects without placements, and hashes of the scene's own settings.

    Objects are sorted by name and library; those of instanced collections and other scenes are
    included, since a scene may show them. Hashes: the active camera, the render settings, the
    world and the collections.
    """
    holders: dict[int, list[str]] = {}
    for collection in [scene.collection, *bpy.data.collections]:
        for member in collection.objects:
            holders.setdefault(member.as_pointer(), []).append(collection.name)
    settings = Settings()
    states = [
        _state(o, sorted(holders.get(o.as_pointer(), ())), settings) for o in bpy.data.objects
    ]
    return sorted(states, key=lambda s: (s.name, s.library or "")), _scene_hashes(scene, settings)


def _scene_hashes(scene: bpy.types.Scene, settings: Settings) -> dict[str, str]:
    camera = scene.camera
    shown = None if camera is None else [camera.name, _matrix(camera), settings.of(camera.data)]
    nodes = compositor(scene)
    render = [settings.of(scene), {} if nodes is None else settings.of(nodes)]
    trees = [_tree(layer.layer_collection, settings) for layer in scene.view_layers]
    collections = [
        [settings.of(collection), _light_links(collection)]
        for collection in [scene.collection, *bpy.data.collections]
    ]
    return {
        "camera": _hash(shown),
        "render": _hash(render),
        "world": _hash(None if scene.world is None else settings.of(scene.world)),
        "collections": _hash([trees, collections]),
    }


def _state(block: bpy.types.Object, collections: list[str], settings: Settings) -> EntityState:
    data = block.data
    materials = [slot.material for slot in block.material_slots]
    rest = settings.of(block)
    custom = rest.pop(CUSTOM, None)
    visibility = {name: rest.pop(name) for name in list(rest) if name.startswith(_VISIBILITY)}
    own = None if data is None or block.type == "MESH" else settings.of(data)
    return EntityState(
        name=block.name,
        library=block.library.filepath if block.library else None,
        type=block.type,
        parent=block.parent.name if block.parent else None,
        collections=tuple(collections),
        transform=_matrix(block),
        data=data.name if data else None,
        data_sha256=_hash([own, rest]),
        mesh_sha256=_hash(settings.of(data)) if block.type == "MESH" else None,
        materials=tuple(m.name if m else None for m in materials),
        material_sha256=_hash([settings.digest(m) if m else None for m in materials]),
        modifiers_sha256=_hash(
            [[settings.of(m) for m in block.modifiers], [settings.of(c) for c in block.constraints]]
        ),
        visibility_sha256=_hash(visibility),
        properties_sha256=_hash(custom),
    )


def _matrix(block: bpy.types.Object) -> tuple[float, ...]:
    rows = [*block.matrix_basis, *block.matrix_parent_inverse]
    return tuple(float(value) for row in rows for value in row)


def _tree(layer: bpy.types.LayerCollection, settings: Settings) -> list[Any]:
    return [
        layer.collection.name,
        settings.of(layer),
        [_tree(child, settings) for child in layer.children],
    ]


def _light_links(collection: bpy.types.Collection) -> list[list[str]]:
    """The members that light linking leaves out; the others are in by being members."""
    pairs = zip(collection.objects, collection.collection_objects, strict=True)
    states = [[member.name, held.light_linking.link_state] for member, held in pairs]
    return [state for state in states if state[1] != "INCLUDE"]


def _hash(value: Any) -> str:
    return sha256_of_text(canonical_json(value))
