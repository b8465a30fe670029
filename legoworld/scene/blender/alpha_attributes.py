"""Mesh attributes as a source of alpha, evaluated per corner as in Cycles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.blender.meshes import Triangles
from legoworld.scene.blender.shader_links import Feed, UnreadableAlphaError

if TYPE_CHECKING:
    import bpy

#: Rec. 709 weights by which Cycles turns a colour into a value.
LUMINANCE_RGB: Final = (0.2126, 0.7152, 0.0722)

Channel = Literal["alpha", "luminance", "fac", "mean"]

#: Names that Cycles gives to attributes of its own: one of the mesh is not what they mean there.
_CYCLES_OWN: Final = (
    "N", "uv", "generated", "generated_transform", "tangent", "tangent_sign", "vertex_color",
    "undeformed", "undeformed_N", "undisplaced", "undisplaced_N", "motion_P", "motion_N",
    "particle", "curve_intercept", "curve_length", "curve_random", "point_random", "ptex_face_id",
    "ptex_uv", "density", "color", "flame", "heat", "temperature", "velocity", "velocity_x",
    "velocity_y", "velocity_z", "pointiness", "random_per_island", "shadow_transparency",
    "position", "material_index",
)  # fmt: skip

_CHANNELS: Final[dict[str, Channel]] = {"Alpha": "alpha", "Color": "luminance", "Vector": "mean"}

#: Attribute types by the property that holds a value, and its numbers.
_STORED: Final = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "INT8": ("value", 1),
    "BOOLEAN": ("value", 1),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),  # Blender gives it linear; its alpha knows no gamma
    "QUATERNION": ("value", 4),
}


@dataclass(frozen=True, kw_only=True)
class AttributeSource:
    """One number of a mesh's attribute.

    node: the Color Attribute node and the Attribute node treat a missing attribute
    differently. name: "" of a Color Attribute node is the colour that a render uses by default.
    channel: the output, as a value socket gets it: "luminance" of Color, "mean" of Vector. "fac" is
    the mean, too, but the first of two numbers.
    """

    node: Literal["attribute", "color attribute"]
    name: str
    channel: Channel


def attribute_source(source: Feed) -> AttributeSource:
    """What an Attribute or a Color Attribute node gives. Raises UnreadableAlphaError."""
    node = source.node
    channel = _CHANNELS.get(source.output.name, "fac")
    if node.type == "VERTEX_COLOR":
        name, kind = str(node.layer_name), "color attribute"
    else:
        name, kind = str(node.attribute_name), "attribute"
        if node.attribute_type != "GEOMETRY":
            of = node.attribute_type.lower().replace("_", " ")
            raise UnreadableAlphaError(f"alpha comes from an attribute of the {of}")
    if name in _CYCLES_OWN:
        raise UnreadableAlphaError(f"alpha comes from an attribute of the reserved name {name!r}")
    if kind == "color attribute":
        return AttributeSource(node="color attribute", name=name, channel=channel)
    return AttributeSource(node="attribute", name=name, channel=channel)


def corner_values(
    mesh: bpy.types.Mesh, shown: bpy.types.Object, source: AttributeSource, triangles: Triangles
) -> NDArray[np.float64]:
    """(T, 3) values at the triangles' corners; Cycles interpolates linearly between them.

    shown: the evaluated object, for its vertex groups. Raises UnreadableAlphaError.
    """
    name = source.name
    if source.node == "color attribute" and not name:
        name = mesh.color_attributes.default_color_name
    attribute = mesh.attributes.get(name) if name else None
    shape = triangles.corners.shape
    if attribute is not None:
        numbers = _read_values(attribute, source)
        only_first = source.channel == "fac" and attribute.data_type == "FLOAT2"
        values = numbers[:, 0] if only_first else _channel(numbers, source.channel)
        at_corners: NDArray[np.float64] = values[_elements(mesh, attribute, triangles)]
        return at_corners
    if source.node == "color attribute":
        return np.zeros(shape)
    if source.channel == "alpha":
        return np.ones(shape)
    group = shown.vertex_groups.get(name) if name else None
    if group is None:
        return np.zeros(shape)
    weights: NDArray[np.float64] = _weights(mesh, group.index)[triangles.vertices]
    return weights


def _read_values(attribute: bpy.types.Attribute, source: AttributeSource) -> NDArray[np.float64]:
    """(N, 4) values: x, y, z and alpha, which is 1 where the type has none."""
    if attribute.data_type not in _STORED:
        kind = attribute.data_type.lower().replace("_", " ")
        raise UnreadableAlphaError(f"alpha comes from an attribute of type {kind}")
    name, count = _STORED[attribute.data_type]
    if source.node == "color attribute" and count < 3:
        raise UnreadableAlphaError("alpha comes from a Color Attribute that is not a colour")
    kind = {"INT": np.int32, "INT8": np.int32, "BOOLEAN": np.bool_}.get(
        attribute.data_type, np.float32
    )
    values = np.empty((len(attribute.data), count), kind)
    attribute.data.foreach_get(name, values.ravel())
    out = np.zeros((len(values), 4))
    out[:, 3] = 1.0
    out[:, :count] = values if count > 1 else 0.0
    if count == 1:
        out[:, :3] = values
    if not np.isfinite(out).all():
        raise UnreadableAlphaError("alpha comes from an attribute with NaN or infinite values")
    return out


def _channel(xyzw: NDArray[np.float64], channel: Channel) -> NDArray[np.float64]:
    if channel == "alpha":
        return xyzw[:, 3]
    weights = LUMINANCE_RGB if channel == "luminance" else (1 / 3, 1 / 3, 1 / 3)
    return np.asarray(xyzw[:, :3] @ np.array(weights), np.float64)


def _elements(
    mesh: bpy.types.Mesh, attribute: bpy.types.Attribute, triangles: Triangles
) -> NDArray[np.int32]:
    """(T, 3), the attribute's element at each corner of each triangle."""
    if attribute.domain == "POINT":
        return triangles.vertices
    if attribute.domain == "CORNER":
        return triangles.corners
    if attribute.domain == "FACE":
        corners_of_face = np.empty(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("loop_total", corners_of_face)
        face = np.repeat(np.arange(len(corners_of_face), dtype=np.int32), corners_of_face)
        of_corner: NDArray[np.int32] = face[triangles.corners]
        return of_corner
    raise UnreadableAlphaError(f"alpha comes from an attribute of every {attribute.domain.lower()}")


def _weights(mesh: bpy.types.Mesh, group: int) -> NDArray[np.float64]:
    """(V,) weights of a vertex group, 0 for vertices outside it."""
    weights = np.zeros(len(mesh.vertices))
    for i, vertex in enumerate(mesh.vertices):
        for member in vertex.groups:
            if member.group == group:
                weights[i] = member.weight
    return weights
