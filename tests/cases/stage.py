"""Building scenes with exact pixels in Blender: one scene unit is one pixel.

`pixel_camera` looks straight down; pixel edges x (rightwards) and y (downwards) of the picture are
turned into world coordinates by `world_xy`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

SIZE_WH = (80, 60)
_CAMERA_Z = 100.0

Point = tuple[float, float, float]


def fresh() -> None:
    """An empty scene of the standard size."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = SIZE_WH


def pixel_camera(size_wh: tuple[int, int] = SIZE_WH, **settings: Any) -> Any:
    """An orthographic camera above the scene whose pixels are scene units; depth is 100 - z."""
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = size_wh
    return camera((0, 0, _CAMERA_Z), type="ORTHO", ortho_scale=float(max(size_wh)), **settings)


def camera(place: Point, **settings: Any) -> Any:
    """The active camera, looking down its world's -z."""
    data = bpy.data.cameras.new("Camera")
    data.clip_start, data.clip_end = 0.1, 1000.0
    for key, value in settings.items():
        setattr(data, key, value)
    made = link(bpy.data.objects.new("Camera", data))
    made.location = place
    bpy.context.scene.camera = made
    return made


def world_xy(x: float, y: float, size_wh: tuple[int, int] = SIZE_WH) -> tuple[float, float]:
    """World coordinates of the picture point (x, y) under `pixel_camera`."""
    return x - size_wh[0] / 2, size_wh[1] / 2 - y


def link(made: Any, collection: Any = None) -> Any:
    """Put an object into a collection, or into the scene itself."""
    (collection or bpy.context.scene.collection).objects.link(made)
    return made


def labelled(made: Any, **labels: Any) -> Any:
    """Give an object or collection custom properties."""
    for key, value in labels.items():
        made[key] = value
    return made


def polygons(
    name: str,
    points: Sequence[Point],
    faces: Sequence[Sequence[int]],
    collection: Any = None,
    **labels: Any,
) -> Any:
    """A mesh object with its points in world coordinates."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    return labelled(link(bpy.data.objects.new(name, mesh), collection), **labels)


def outline(
    name: str, points: Sequence[tuple[float, float]], z: float = 0.0, **settings: Any
) -> Any:
    """One n-gon around picture points."""
    return polygons(
        name, [(*world_xy(x, y), z) for x, y in points], [range(len(points))], **settings
    )


def box(
    name: str, x0: float, y0: float, x1: float, y1: float, z: float = 0.0, **settings: Any
) -> Any:
    """A rectangle over the picture's edges x0..x1, y0..y1."""
    return outline(name, [(x0, y1), (x1, y1), (x1, y0), (x0, y0)], z, **settings)


def square(name: str, side: float = 1.0, collection: Any = None, **labels: Any) -> Any:
    """A square around its own origin."""
    h = side / 2
    points = [(-h, -h, 0.0), (h, -h, 0.0), (h, h, 0.0), (-h, h, 0.0)]
    return polygons(name, points, [(0, 1, 2, 3)], collection, **labels)


def at(made: Any, x: float, y: float, z: float = 0.0) -> Any:
    """Move an object's origin to a picture point."""
    made.location = (*world_xy(x, y), z)
    return made


def empty(name: str, collection: Any = None, **labels: Any) -> Any:
    """An empty."""
    return labelled(link(bpy.data.objects.new(name, None), collection), **labels)


def collection(name: str, parent: Any = "scene", **labels: Any) -> Any:
    """A collection: in the scene, in another one, or (None) in no other."""
    made = bpy.data.collections.new(name)
    if parent == "scene":
        parent = bpy.context.scene.collection
    if parent is not None:
        parent.children.link(made)
    return labelled(made, **labels)


def instance_of(
    source: Any, name: str, x: float, y: float, target: Any = None, **labels: Any
) -> Any:
    """An empty that instances a collection at a picture point."""
    made = empty(name, target, **labels)
    made.instance_type, made.instance_collection = "COLLECTION", source
    return at(made, x, y)


def material(name: str, made: Any = None, **inputs: Any) -> Any:
    """A Principled material with these input values, put on an object."""
    shader = bpy.data.materials.new(name)
    for key, value in inputs.items():
        shader.node_tree.nodes["Principled BSDF"].inputs[
            key.replace("_", " ")
        ].default_value = value
    if made is not None:
        made.data.materials.append(shader)
    return shader


def nodes(name: str = "Nodes") -> tuple[Any, Any, Any]:
    """A geometry node group with a geometry input and output: (group, input node, output node)."""
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    return group, group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")


def scatter(on: Any, *, thing: Any = None, group: Any = None, pick: bool = False) -> None:
    """Instance an object, or a collection (whole, or its members in turn), on all points."""
    tree, given, result = nodes(f"Scatter on {on.name}")
    instance = tree.nodes.new("GeometryNodeInstanceOnPoints")
    instance.inputs["Pick Instance"].default_value = pick
    if thing is not None:
        source = tree.nodes.new("GeometryNodeObjectInfo")
        source.inputs["Object"].default_value = thing
        source.inputs["As Instance"].default_value = True
        out = source.outputs["Geometry"]
    else:
        source = tree.nodes.new("GeometryNodeCollectionInfo")
        source.inputs["Collection"].default_value = group
        source.inputs["Separate Children"].default_value = pick
        source.inputs["Reset Children"].default_value = pick
        out = source.outputs[0]
    tree.links.new(given.outputs[0], instance.inputs["Points"])
    tree.links.new(out, instance.inputs["Instance"])
    tree.links.new(instance.outputs[0], result.inputs[0])
    on.modifiers.new("Scatter", "NODES").node_group = tree


def points(
    name: str, places: Sequence[tuple[float, float]], z: float = 0.0, **settings: Any
) -> Any:
    """A mesh of loose points at picture points."""
    return polygons(name, [(*world_xy(x, y), z) for x, y in places], [], **settings)
