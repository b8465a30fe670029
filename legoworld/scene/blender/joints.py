"""The `joint` properties of an open .blend, with the frames of the objects that have one."""

from __future__ import annotations

import json
import math
from typing import Any, Final

import bpy

_SHOWN_TEXT: Final = 2000


def joint_facts(scene: bpy.types.Scene) -> list[dict[str, Any]]:
    """object, parent (null for none), text and world_from_object, by name.

    world_from_object: 12 numbers, rows, scene units; null where they are not finite. The file is
    evaluated only where a property is found.
    """
    jointed = sorted((o for o in scene.objects if "joint" in o), key=lambda o: o.name)
    if not jointed:
        return []
    layer = scene.view_layers[0]
    layer.update()
    return [
        {
            "object": thing.name,
            "parent": thing.parent.name if thing.parent else None,
            "text": _property_text(thing["joint"])[:_SHOWN_TEXT],
            "world_from_object": _rows(thing.evaluated_get(layer.depsgraph)),
        }
        for thing in jointed
    ]


def _rows(evaluated: Any) -> list[float] | None:
    values = [float(value) for row in evaluated.matrix_world[:3] for value in row]
    return values if all(map(math.isfinite, values)) else None


def _property_text(value: Any) -> str:
    """A custom property as text; groups and arrays as JSON."""
    if hasattr(value, "to_dict"):
        value = value.to_dict()
    elif hasattr(value, "to_list"):
        value = value.to_list()
    return value if isinstance(value, str) else json.dumps(value, sort_keys=True, default=str)
