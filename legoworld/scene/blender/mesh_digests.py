"""Digests of geometry, which is read as arrays and not value by value."""

from __future__ import annotations

import hashlib
from typing import Any, Final

import bpy
import numpy as np

from legoworld.files import canonical_json


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
