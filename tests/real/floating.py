"""What floats in scenes: python floating.py SCENE.blend... prints {scene: [thing, ...]} as JSON.

A thing stands where one of its lowest corners is within 2 cm of a surface below it, and hangs or
leans where its surface meets another thing's.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector
from mathutils.bvhtree import BVHTree

_NEAR_M = 0.02
_DOWN = Vector((0.0, 0.0, -1.0))


def surface(root: Any) -> tuple[list[Vector], BVHTree]:
    """World vertices of a thing with what belongs to it, and its faces as a tree."""
    places: list[Vector] = []
    faces: list[list[int]] = []
    for part in (root, *root.children_recursive):
        if part.type == "MESH":
            first = len(places)
            places += [part.matrix_world @ v.co for v in part.data.vertices]
            faces += [[first + i for i in f.vertices] for f in part.data.polygons]
    return places, BVHTree.FromPolygons(places, faces)


def floating(path: str) -> list[str]:
    """Names of the labelled things of a scene that neither stand nor touch anything."""
    bpy.ops.wm.open_mainfile(filepath=path)
    roots = [o for o in bpy.context.scene.objects if o.parent is None and o.type != "CAMERA"]
    made = {root.name: surface(root) for root in roots if root.type in ("MESH", "EMPTY")}
    found = []
    for root in roots:
        if "category" not in root:
            continue
        places, tree = made[root.name]
        others = [other for name, (_, other) in made.items() if name != root.name]
        low, high = min(p.z for p in places), max(p.z for p in places)
        bottom = [p for p in places if p.z <= low + 0.02 * (high - low) + 1e-4]
        stands = any(
            other.ray_cast(p - _NEAR_M * _DOWN, _DOWN, 2 * _NEAR_M)[0] is not None
            for p in bottom for other in others
        )  # fmt: skip
        if not stands and not any(tree.overlap(other) for other in others):
            found.append(root.name)
    return found


print("\n" + json.dumps({Path(path).parent.name: floating(path) for path in sys.argv[1:]}))
