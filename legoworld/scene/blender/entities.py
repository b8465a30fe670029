"""Every object of the open file with hashes of its settings: what a transaction compares.

Settings are read through Blender's own description of its types (RNA): what the file keeps and a
person can set counts, what only the window shows (selection, node positions) does not.
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np

from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.records.plugin_state import EntityState
from legoworld.scene.blender.integrity import compositor

#: Settings of the window, caches and bookkeeping: equal scenes may differ in them.
_IGNORED: Final = frozenset((
    "rna_type", "name_full", "session_uid", "users", "tag", "is_evaluated", "original",
    "preview", "asset_data", "use_fake_user", "use_extra_user", "is_runtime_data", "is_missing",
    "is_linked_packed", "library_weak_reference", "override_library", "select", "hide",
    "location_absolute", "show_preview", "show_texture", "show_options", "show_expanded",
    "show_in_editmode", "show_on_cage", "show_viewport", "is_active", "is_active_output",
    "active_material_index", "active_shape_key_index", "active", "active_index", "active_input",
    "active_output", "dimensions", "width_hidden", "color_tag", "use_custom_color",
    "execution_time", "persistent_uid", "is_embedded_data", "is_library_indirect", "id_type",
    "animation_data", "interface", "view_center", "links", "grease_pencil",
    "debug_lazy_function_graph", "debug_zone_body_lazy_function_graph",
    "debug_zone_lazy_function_graph", "paint_active_slot", "paint_clone_slot",
    "texture_paint_images", "texture_paint_slots",
))  # fmt: skip
#: Where a node lies in its editor.
_OF_NODES: Final = frozenset(("location", "width", "height", "color", "label", "parent",
                              "show_header", "warning_propagation"))  # fmt: skip


def entity_states(scene: bpy.types.Scene) -> list[EntityState]:
    """The file's objects sorted by name and library, without their placements.

    Those of instanced collections and of other scenes are among them: a scene may show them, too.
    """
    holders: dict[int, list[str]] = {}
    for collection in [scene.collection, *bpy.data.collections]:
        for member in collection.objects:
            holders.setdefault(member.as_pointer(), []).append(collection.name)
    states = [_state(o, sorted(holders.get(o.as_pointer(), ()))) for o in bpy.data.objects]
    return sorted(states, key=lambda state: (state.name, state.library or ""))


def scene_hashes(scene: bpy.types.Scene) -> dict[str, str]:
    """Hashes of the active camera, the render settings, the world and the collection tree."""
    camera = scene.camera
    shown = None if camera is None else [camera.name, _matrix(camera), described(camera.data)]
    render = [described(scene.render), described(scene.view_settings), described(scene.cycles)]
    nodes = compositor(scene)
    render.append({} if nodes is None else described(nodes))
    display = scene.display_settings.display_device
    frame = [scene.frame_current, scene.frame_subframe, scene.unit_settings.scale_length]
    return {
        "camera": _hash(shown),
        "render": _hash([render, display, frame]),
        "world": _hash(None if scene.world is None else described(scene.world)),
        "collections": _hash(_tree(scene.view_layers[0].layer_collection)),
    }


def described(struct: bpy.types.bpy_struct) -> dict[str, Any]:
    """Every setting of an RNA struct by name, nested structs included, other IDs by name.

    A struct that is met again on the way (a socket's node, say) is not described twice.
    """
    return _described(struct, set())


def _described(struct: bpy.types.bpy_struct, met: set[tuple[int, str]]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    rna: Any = type(struct)
    for name, kind in _settings(rna):
        if kind == "POINTER":
            values[name] = _nested(getattr(struct, name), met)
        elif kind == "COLLECTION":
            values[name] = [_nested(item, met) for item in getattr(struct, name)]
        else:
            values[name] = _plain(getattr(struct, name))
    if isinstance(struct, bpy.types.NodeTree):
        values["links"] = sorted(_link(link) for link in struct.links)
    return values


@functools.cache
def _settings(kind: Any) -> tuple[tuple[str, str], ...]:
    """Name and type of each setting of an RNA type that counts, in Blender's order."""
    ignored = _IGNORED | _OF_NODES if issubclass(kind, bpy.types.Node) else _IGNORED
    return tuple(
        (prop.identifier, prop.type)
        for prop in kind.bl_rna.properties
        if prop.identifier not in ignored
        and (
            prop.type in ("POINTER", "COLLECTION")
            or not prop.is_readonly
            or prop.identifier in ("identifier", "type", "bl_idname")
        )
    )


def _nested(value: Any, met: set[tuple[int, str]]) -> Any:
    if not isinstance(value, bpy.types.bpy_struct):
        return None
    if isinstance(value, bpy.types.Image):
        return _image(value)
    if isinstance(value, bpy.types.ID) and not isinstance(value, bpy.types.NodeTree):
        return [type(value).__name__, value.name, value.library.filepath if value.library else None]
    place = (value.as_pointer(), type(value).__name__)  # a first member lies where its owner does
    if place in met:
        return None
    met.add(place)
    return _described(value, met)


def _image(image: bpy.types.Image) -> list[Any]:
    """An image by where its pixels come from; those that lie in the .blend by their bytes."""
    settings = [image.name, image.source, image.filepath, image.alpha_mode, list(image.size)]
    packed = image.packed_file
    content = hashlib.sha256(packed.data).hexdigest() if packed else _file_sha256(image)
    drawn = _pixels_sha256(image) if image.is_dirty or image.source == "GENERATED" else None
    return [*settings, image.colorspace_settings.name, content, drawn]


def _file_sha256(image: bpy.types.Image) -> str | None:
    """The bytes of the file that an image names; None where it names none, or none is there."""
    path = Path(bpy.path.abspath(image.filepath, library=image.library))
    try:
        about = path.stat()
    except OSError:
        return None
    # By the time of its last change, which no program can set back as it can the modification time.
    seen = about.st_ctime_ns, about.st_ino, about.st_size
    return _content_sha256(path, seen) if path.is_file() else None


@functools.lru_cache(maxsize=1024)
def _content_sha256(path: Path, _seen: tuple[int, int, int]) -> str:
    return sha256_of_file(path)


def _pixels_sha256(image: bpy.types.Image) -> str:
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return hashlib.sha256(pixels.tobytes()).hexdigest()


def _link(link: bpy.types.NodeLink) -> list[str]:
    ends = (link.from_node.name, link.from_socket.identifier, link.to_node.name)
    return [*ends, link.to_socket.identifier]


def _plain(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return repr(float(value))  # NaN and infinities are settings, too
    if isinstance(value, bool | int | str) or value is None:
        return value
    if isinstance(value, set):
        return sorted(value)
    if isinstance(value, bytes):
        return value.hex()
    return [_plain(item) for item in value]


def _state(block: bpy.types.Object, collections: list[str]) -> EntityState:
    data = block.data
    materials = [slot.material for slot in block.material_slots]
    return EntityState(
        name=block.name,
        library=block.library.filepath if block.library else None,
        type=block.type,
        parent=block.parent.name if block.parent else None,
        collections=tuple(collections),
        transform=_matrix(block),
        data=data.name if data else None,
        data_sha256=_hash(None if data is None or block.type == "MESH" else described(data)),
        mesh_sha256=_mesh_sha256(data) if block.type == "MESH" else None,
        materials=tuple(m.name if m else None for m in materials),
        material_sha256=_hash([described(m) if m else None for m in materials]),
        modifiers_sha256=_hash(
            [[described(m) for m in block.modifiers], [described(c) for c in block.constraints]]
        ),
        visibility_sha256=_hash(
            [
                block.hide_render,
                block.hide_viewport,
                block.visible_camera,
                block.is_holdout,
                block.instance_type,
                block.instance_collection and block.instance_collection.name,
            ]
        ),
        properties_sha256=_hash(_properties(block)),
    )


def _matrix(block: bpy.types.Object) -> tuple[float, ...]:
    rows = [*block.matrix_basis, *block.matrix_parent_inverse]
    return tuple(float(value) for row in rows for value in row)


def _properties(block: bpy.types.ID) -> dict[str, Any]:
    """Custom properties, those of datablocks by name."""
    return {key: _property(block[key]) for key in sorted(block.keys())}


def _property(value: Any) -> Any:
    """One custom property's value: groups and lists of them by what they hold, never by address."""
    if isinstance(value, bpy.types.ID):
        return [type(value).__name__, value.name]
    if hasattr(value, "keys"):
        return {key: _property(value[key]) for key in sorted(value.keys())}
    if hasattr(value, "to_list"):
        value = value.to_list()
    if isinstance(value, list | tuple):
        return [_property(item) for item in value]
    return value if isinstance(value, str | int | bool) or value is None else repr(value)


def _mesh_sha256(mesh: bpy.types.Mesh) -> str:
    """Hash of all attributes of a mesh, positions and faces included, and of its shape keys."""
    digest = hashlib.sha256()
    counts = [len(mesh.vertices), len(mesh.edges), len(mesh.loops), len(mesh.polygons)]
    digest.update(canonical_json([counts, _attribute_names(mesh)]).encode())
    starts = np.empty(counts[3], np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    digest.update(starts.tobytes())
    for attribute in mesh.attributes:
        if attribute.name.startswith(".select") or attribute.name.startswith(".hide"):
            continue
        digest.update(_attribute_bytes(attribute))
    if mesh.shape_keys:
        for key in mesh.shape_keys.key_blocks:
            points = np.empty(3 * counts[0], np.float32)
            key.data.foreach_get("co", points)
            digest.update(canonical_json([key.name, repr(key.value), key.mute]).encode())
            digest.update(points.tobytes())
    return digest.hexdigest()


def _attribute_names(mesh: bpy.types.Mesh) -> list[list[str]]:
    return [
        [a.name, a.domain, a.data_type]
        for a in mesh.attributes
        if not a.name.startswith((".select", ".hide"))
    ]


#: How an attribute's values are read: the field's name, numbers per value, their type.
_FIELDS: Final[dict[str, tuple[str, int, Any]]] = {
    "FLOAT": ("value", 1, np.float32),
    "INT": ("value", 1, np.int32),
    "INT8": ("value", 1, np.int8),
    "BOOLEAN": ("value", 1, np.bool_),
    "FLOAT_VECTOR": ("vector", 3, np.float32),
    "FLOAT2": ("vector", 2, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32),
    "BYTE_COLOR": ("color", 4, np.float32),
    "INT32_2D": ("value", 2, np.int32),
    "INT16_2D": ("value", 2, np.int32),
    "QUATERNION": ("value", 4, np.float32),
    "FLOAT4X4": ("value", 16, np.float32),
}


def _attribute_bytes(attribute: bpy.types.Attribute) -> bytes:
    known = _FIELDS.get(attribute.data_type)
    if known is None:  # texts
        return repr([item.value for item in attribute.data]).encode()
    field, width, kind = known
    values = np.empty(width * len(attribute.data), kind)
    attribute.data.foreach_get(field, values)
    return values.tobytes()


def _tree(layer: bpy.types.LayerCollection) -> list[Any]:
    collection = layer.collection
    switches = [layer.exclude, layer.holdout, layer.indirect_only, collection.hide_render]
    return [collection.name, switches, [_tree(child) for child in layer.children]]


def _hash(value: Any) -> str:
    return sha256_of_text(canonical_json(value))
