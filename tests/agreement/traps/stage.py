"""What the trap scenes are built with. Runs in the building process only: it imports bpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import Any

import bpy
from mathutils import Vector

Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Expect:
    """Objects that Cycles must see at all, and must not, for the trap to be one.

    limited: objects that a declared limit reads otherwise than Cycles; a warning must name each.
    """

    seen: Sequence[str]
    unseen: Sequence[str] = ()
    limited: Sequence[str] = ()


def empty_stage() -> None:
    """A new file with a 320 x 240 picture and no object."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 320, 240


def camera(
    at: Triple = (0.0, -10.0, 4.0),
    target: Triple = (0.0, 0.0, 0.5),
    name: str = "Camera",
    **lens: Any,
) -> Any:
    """A camera that looks at a target, made active."""
    data = bpy.data.cameras.new(name)
    for key, value in lens.items():
        setattr(data, key, value)
    shown = link(bpy.data.objects.new(name, data))
    shown.location = at
    shown.rotation_euler = (Vector(target) - Vector(at)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.camera = shown
    return shown


def link(block: Any, collection: Any = None) -> Any:
    """Put an object into a collection, the scene's own by default."""
    (collection or bpy.context.scene.collection).objects.link(block)
    return block


def solid(
    kind: str,
    name: str,
    at: Triple = (0.0, 0.0, 0.0),
    *,
    scale: Triple = (1.0, 1.0, 1.0),
    turn: Triple = (0.0, 0.0, 0.0),
    material: Any = None,
    collection: Any = None,
    **shape: Any,
) -> Any:
    """A mesh primitive: cube, uv_sphere, ico_sphere, cylinder, cone, torus, plane, monkey, grid.

    turn: degrees. shape: what the operator takes besides.
    """
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")(**shape)
    made = bpy.context.object
    made.name = name
    made.location, made.scale = at, scale
    made.rotation_euler = tuple(radians(a) for a in turn)
    if material is not None:
        made.data.materials.append(material)
    if collection is not None:
        for holder in list(made.users_collection):
            holder.objects.unlink(made)
        collection.objects.link(made)
    return made


def polygons(
    name: str, points: Sequence[Triple], faces: Sequence[Sequence[int]], at: Triple = (0, 0, 0)
) -> Any:
    """A mesh object from points and faces."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(list(points), [], [list(f) for f in faces])
    made = link(bpy.data.objects.new(name, mesh))
    made.location = at
    return made


def floor(size: float = 30.0, name: str = "Floor") -> Any:
    """A ground plane at z = 0."""
    return solid("plane", name, size=size)


def wall(y: float = 6.0, name: str = "Wall") -> Any:
    """A large wall that faces the camera, behind everything."""
    return solid("plane", name, (0, y, 0), turn=(90, 0, 0), size=60)


def collection(name: str, parent: Any = None) -> Any:
    """A new collection, linked into the scene or another collection."""
    made = bpy.data.collections.new(name)
    (parent or bpy.context.scene.collection).children.link(made)
    return made


def unlinked_collection(name: str) -> Any:
    """A collection that only instances will show."""
    return bpy.data.collections.new(name)


def instance_of(what: Any, name: str, at: Triple, into: Any = None, **transform: Any) -> Any:
    """An empty that instances a collection."""
    empty = link(bpy.data.objects.new(name, None), into)
    empty.instance_type = "COLLECTION"
    empty.instance_collection = what
    empty.location = at
    for key, value in transform.items():
        setattr(empty, key, value)
    return empty


def layer_of(name: str) -> Any:
    """The active view layer's entry of a top-level collection."""
    return bpy.context.view_layer.layer_collection.children[name]


def material(name: str, build: Any) -> Any:
    """A material whose nodes `build(tree)` makes; it returns the socket of the surface."""
    made = bpy.data.materials.new(name)
    tree = made.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    surface = build(tree)
    if surface is not None:
        tree.links.new(surface, output.inputs["Surface"])
    return made


def principled(name: str, **inputs: Any) -> Any:
    """A Principled material; inputs by name with underscores for spaces."""

    def build(tree: Any) -> Any:
        shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
        for key, value in inputs.items():
            shader.inputs[key.replace("_", " ")].default_value = value
        return shader.outputs[0]

    return material(name, build)
