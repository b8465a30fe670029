"""Everything that Blender saves of a datablock, through its own description of its types (RNA).

Every property counts that a file keeps and a person can set, and every custom property, but for
those of a short list with their reasons.
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np

from legoworld.files import canonical_json, sha256_of_file, sha256_of_text


def mesh_sha256(mesh: bpy.types.Mesh) -> str:
    """Hash of all attributes of a mesh, positions and faces included."""
    digest = hashlib.sha256()
    counts = [len(mesh.vertices), len(mesh.edges), len(mesh.loops), len(mesh.polygons)]
    rendered = [layer.name for layer in mesh.uv_layers if layer.active_render]
    rendered.append(mesh.color_attributes.render_color_index)
    digest.update(canonical_json([counts, _attribute_names(mesh), rendered]).encode())
    starts = np.empty(counts[3], np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    digest.update(starts.tobytes())
    for attribute in mesh.attributes:
        if attribute.name.startswith(".select") or attribute.name.startswith(".hide"):
            continue
        digest.update(_attribute_bytes(attribute))
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


def shape_key_sha256(key: bpy.types.ShapeKey) -> str:
    """Hash of the points of a shape key."""
    points = np.empty(3 * len(key.data), np.float32)
    key.data.foreach_get("co", points)
    return hashlib.sha256(points.tobytes()).hexdigest()


#: The key of custom properties among the settings.
CUSTOM: Final = "[custom properties]"

#: Properties that are not scene settings, by reason.
_IGNORED: Final = {
    "the identity of a datablock in this process or library": """
        rna_type name_full session_uid users tag is_evaluated original preview asset_data
        use_fake_user use_extra_user is_runtime_data is_missing is_linked_packed is_embedded_data
        library_weak_reference override_library is_library_indirect id_type persistent_uid
        execution_time""",
    "what a window shows, and what is chosen in it": """
        select hide select_control_point select_left_handle select_right_handle show_preview
        show_texture show_options show_expanded show_in_editmode show_on_cage show_viewport
        is_active active active_index active_input active_output active_material_index
        active_shape_key_index active_strip active_layer_collection active_keying_set
        active_color_index width_hidden color_tag use_custom_color view_center grease_pencil
        paint_active_slot paint_clone_slot texture_paint_images texture_paint_slots
        debug_lazy_function_graph debug_zone_body_lazy_function_graph
        debug_zone_lazy_function_graph""",
    "made from other settings": "dimensions location_absolute links depsgraph",
    "what a new node of a group begins with": "interface",
    "read through an object's slots": "materials",
    "points back to who holds it": "user owner id_root",
}
#: The same of one type and what derives from it.
_IGNORED_OF: Final = {
    "Node": """location width height color label parent show_header warning_propagation""",
    "Object": """data parent children modifiers constraints material_slots mode matrix_basis
        matrix_local matrix_parent_inverse matrix_world location rotation_axis_angle rotation_euler
        rotation_quaternion rotation_mode scale delta_location delta_rotation_euler
        delta_rotation_quaternion delta_scale active_material active_shape_key display display_type
        display_bounds_type show_axis show_bounds show_in_front show_name show_texture_space
        show_transparent show_wire show_all_edges empty_display_size empty_display_type
        motion_path animation_visualization pose_library""",
    "PoseBone": "matrix head tail bone children motion_path color custom_shape",
    "Pose": "animation_visualization",
    "Bone": "children color",
    "Armature": "edit_bones",
    "Mesh": """vertices edges loops loop_triangles loop_triangle_polygons polygons attributes
        uv_layers uv_layer_clone uv_layer_stencil color_attributes vertex_normals polygon_normals
        corner_normals skin_vertices vertex_paint_masks""",
    "ShapeKey": "data points relative_key",
    "FCurve": "color color_mode lock auto_smoothing group",
    "AnimData": "action_suitable_slots use_tweak_mode",
    "Collection": "objects children all_objects collection_objects collection_children",
    "LayerCollection": "collection children hide_viewport",
    "ViewLayer": "layer_collection objects",
    "Scene": """camera world collection objects node_tree compositing_node_group tool_settings
        cursor transform_orientation_slots keying_sets keying_sets_all safe_areas annotation""",
    "SequenceEditor": "strips_all selected_retiming_keys meta_stack show_overlay_frame",
}
#: Datablocks that stand for themselves in a state: others name them.
_NAMED: Final = (
    bpy.types.Object, bpy.types.Collection, bpy.types.Scene, bpy.types.Library, bpy.types.Screen,
    bpy.types.WorkSpace, bpy.types.WindowManager, bpy.types.Brush,
)  # fmt: skip


class Settings:
    """The settings of datablocks of one open file; each is described once."""

    def __init__(self) -> None:
        self._digests: dict[int, str] = {}

    def of(self, struct: bpy.types.bpy_struct) -> dict[str, Any]:
        """Every setting of an RNA struct by name, nested structs included, other IDs by content.

        Objects, collections and scenes are named only: they are entities of their own. A struct
        that is met again on the way (a socket's node, say) is not described twice.
        """
        return self._read_struct(struct, set())

    def digest(self, block: bpy.types.ID) -> str:
        """Hash of a datablock's settings and of those that it uses; its name where it is within."""
        place = block.as_pointer()
        if place not in self._digests:
            self._digests[place] = block.name  # of a driver, say, that reads its own material
            self._digests[place] = sha256_of_text(canonical_json(self.of(block)))
        return self._digests[place]

    def _read_struct(
        self, struct: bpy.types.bpy_struct, visited: set[tuple[int, str]]
    ) -> dict[str, Any]:
        values: dict[str, Any] = {}
        rna: Any = type(struct)
        for name, kind in _settings(rna):
            if kind == "POINTER":
                values[name] = self._read_nested(getattr(struct, name), visited)
            elif kind == "COLLECTION":
                values[name] = [self._read_nested(item, visited) for item in getattr(struct, name)]
            else:
                values[name] = _plain(getattr(struct, name))
        if isinstance(struct, bpy.types.NodeTree):
            values["links"] = sorted(_link(link) for link in struct.links)
        if isinstance(struct, bpy.types.Mesh):
            values["geometry"] = mesh_sha256(struct)
        if isinstance(struct, bpy.types.ShapeKey):
            values["geometry"] = shape_key_sha256(struct)
        if custom := _custom(struct):
            values[CUSTOM] = custom
        return values

    def _read_nested(self, value: Any, visited: set[tuple[int, str]]) -> Any:
        if not isinstance(value, bpy.types.bpy_struct):
            return None if value is None else repr(value)
        if isinstance(value, bpy.types.Image):
            return _image(value)
        if isinstance(value, bpy.types.ID):
            library = value.library.filepath if value.library else None
            named = [type(value).__name__, value.name, library]
            return named if isinstance(value, _NAMED) else [*named, self.digest(value)]
        place = (
            value.as_pointer(),
            type(value).__name__,
        )  # a first member lies where its owner does
        if place in visited:
            return None
        visited.add(place)
        return self._read_struct(value, visited)


@functools.cache
def _settings(kind: Any) -> tuple[tuple[str, str], ...]:
    """Name and type of each setting of an RNA type that counts, in Blender's order."""
    ignored = {name for names in _IGNORED.values() for name in names.split()}
    for base in kind.__mro__:
        ignored |= set(_IGNORED_OF.get(base.__name__, "").split())
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


def _custom(struct: bpy.types.bpy_struct) -> dict[str, Any]:
    """Custom properties of a struct, those of datablocks by name; empty where it can have none."""
    if isinstance(struct, bpy.types.PropertyGroup):
        return {}  # an add-on's, such as Cycles': they are described as settings
    try:
        return {key: _property(struct[key]) for key in sorted(struct.keys())}
    except TypeError:  # the type has none
        return {}


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
