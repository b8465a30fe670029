"""Scenes of rows 15 to 21: what counts as one instance."""

from __future__ import annotations

from typing import Any

import bpy
from cases.stage import (
    at,
    box,
    collection,
    empty,
    instance_of,
    link,
    pixel_camera,
    points,
    polygons,
    scatter,
    square,
    world_xy,
)


def five_parts() -> None:
    pixel_camera()
    group = collection("Chair in a collection", category="chair")
    root = empty("Chair under an empty", category="chair")
    joined, faces = [], []
    for i in range(5):
        x = 10 + 12 * i
        box(f"Part {i}", x, 5, x + 10, 15, collection=group)
        box(f"Child {i}", x, 20, x + 10, 30).parent = root
        corners = [(x, 45), (x + 10, 45), (x + 10, 35), (x, 35)]
        joined += [(*world_xy(*corner), 0.0) for corner in corners]
        faces.append(range(4 * i, 4 * i + 4))
    polygons("Chair joined", joined, faces, category="chair")


def shared_mesh() -> None:
    pixel_camera()
    first = at(square("Chair", 10, category="chair"), 20, 30)
    second = at(link(bpy.data.objects.new("Chair.001", first.data)), 60, 30)
    second["category"] = "chair"


def names() -> None:
    pixel_camera()
    for i, name in enumerate(("Chair", "Chair.001", "椅子 🪑", "a/b\\c", 'say "x"')):
        box(name, 10 * i, 10, 10 * i + 8, 18, category="chair")


def seventy_thousand() -> None:
    size_wh = (280, 250)
    pixel_camera(size_wh)
    grain = square("Grain", 0.9, collection("Store", None), category="apple")
    places = [(x + 0.5, y + 0.5) for y in range(size_wh[1]) for x in range(size_wh[0])]
    sand = polygons("Sand", [(*world_xy(x, y, size_wh), 0) for x, y in places], [])
    scatter(sand, thing=grain)


def collection_three_times() -> None:
    pixel_camera()
    source = collection("Stool", None, category="chair")
    square("Seat", 8, source)
    square("Leg", 2, source).location.y = -5
    for i in range(3):
        instance_of(source, f"Place {i}", 15 + 25 * i, 30)


def nested_collections() -> None:
    pixel_camera()
    stool = collection("Stool", None, category="chair")
    square("Seat", 4, stool)
    square("Leg", 2, stool).location.y = -3
    row = collection("Row of stools", None)
    for i in range(3):
        instance_of(stool, f"Stool {i}", 35 + 5 * i, 30, row)
    for i in range(2):
        instance_of(row, f"Row {i}", 40, 15 + 30 * i)


def labelled_inside_a_collection() -> None:
    pixel_camera()
    bowl = collection("Bowl with fruit", None)
    square("Bowl", 12, bowl)
    for i in range(2):
        fruit = square(f"Apple {i}", 4, bowl, category="apple")
        fruit.location = (6 * i - 3, 0, 1)
    for i in range(2):
        instance_of(bowl, f"Place {i}", 20 + 40 * i, 30)


def scattered() -> None:
    """A labelled object, a labelled collection (whole and picked from), and a labelled ground."""
    pixel_camera()
    store = collection("Store", None)
    apple = square("Apple", 4, store, category="apple")
    leaf = square("Leaf", 4, store)
    stool = collection("Stool", None, category="chair")
    square("Seat", 4, stool)
    square("Leg", 2, stool).location.y = -3
    stones = collection("Stones", None, category="stone")
    square("Round stone", 4, stones)
    square("Large stone", 6, stones)
    scatter(points("Apples", [(10, 8), (20, 8), (30, 8)]), thing=apple)
    scatter(points("Stools", [(10, 20), (20, 20), (30, 20), (40, 20)]), group=stool)
    scatter(points("Rocks", [(10, 35), (20, 35), (30, 35), (40, 35)]), group=stones, pick=True)
    hedge = points("Hedge", [(10, 50), (20, 50), (30, 50)], category="bush")
    scatter(hedge, thing=leaf)


def particles() -> None:
    pixel_camera()
    apple = square("Apple", 4, collection("Store", None), category="apple")
    stool = collection("Stool", None, category="chair")
    square("Seat", 6, stool)
    square("Leg", 2, stool)
    for i, (name, settings) in enumerate(
        {
            "Tree": {"render_type": "OBJECT", "instance_object": apple},
            "Room": {
                "render_type": "COLLECTION",
                "instance_collection": stool,
                "use_whole_collection": True,
            },
        }.items()
    ):
        x = 10 + 40 * i
        corners = [(x, 50), (x + 20, 50), (x + 20, 10), (x, 10)]
        emitter = polygons(name, [(*world_xy(*c), 0) for c in corners], [(0, 1, 2, 3)])
        emitter.show_instancer_for_render = False
        emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
        made = emitter.particle_systems[0].settings
        made.count, made.emit_from, made.use_emit_random = 4, "VERT", False
        made.frame_start = made.frame_end = 1
        made.lifetime, made.physics_type, made.particle_size = 100, "NO", 1.0
        made.use_rotations, made.rotation_mode = True, "GLOB_X"
        for key, value in settings.items():
            setattr(made, key, value)


def vertex_duplicates() -> None:
    pixel_camera()
    tree = points("Tree", [(10, 10), (30, 10), (50, 10)], category="tree")
    tree.instance_type = "VERTS"
    square("Leaf", 6).parent = tree
    field = points("Field", [(10, 40), (30, 40), (50, 40)])
    field.instance_type = "VERTS"
    square("Apple", 6, category="apple").parent = field


def kinds() -> None:
    pixel_camera()
    curve = bpy.data.curves.new("Curve", "CURVE")
    curve.dimensions, curve.fill_mode = "2D", "BOTH"
    spline = curve.splines.new("POLY")
    spline.points.add(3)
    spline.use_cyclic_u = True
    for point, (x, y) in zip(spline.points, [(0, 0), (8, 0), (8, 8), (0, 8)], strict=True):
        point.co = (x, y, 0, 1)
    at(link(bpy.data.objects.new("Curve", curve)), 10, 20)["category"] = "curve"
    text = bpy.data.curves.new("Text", "FONT")
    text.body, text.size = "I", 20
    at(link(bpy.data.objects.new("Text", text)), 30, 25)["category"] = "text"
    meta = bpy.data.metaballs.new("Meta")
    meta.elements.new().radius = 8
    at(link(bpy.data.objects.new("Meta", meta)), 60, 20)["category"] = "ball"
    hair = bpy.data.hair_curves.new("Hair")
    hair.add_curves([2])
    hair.position_data.foreach_set("vector", [0, 0, 0, 16, 0, 0])
    hair.attributes.new("radius", "FLOAT", "POINT").data.foreach_set("value", [2, 2])
    at(link(bpy.data.objects.new("Hair", hair)), 20, 50)["category"] = "hair"
    # Its face is seen edge-on: all that shows of it is hair, a strand at each corner.
    corners = [(0, -4, 0), (0, 4, 0), (0, 4, -8), (0, -4, -8)]
    furry = at(polygons("Furry", corners, [(3, 2, 1, 0)], category="cat"), 50, 45)
    furry.modifiers.new("Fur", "PARTICLE_SYSTEM")
    fur = furry.particle_systems[0].settings
    fur.type, fur.count, fur.emit_from, fur.use_emit_random = "HAIR", 4, "VERT", False
    fur.hair_length, fur.root_radius, fur.tip_radius, fur.radius_scale = 12, 1, 1, 4
    fur.use_close_tip = False
    cloud = polygons("Cloud", [(0, 0, 0), (12, 0, 0)], [], category="cloud")
    at(cloud, 10, 35)
    _points_of(cloud, 5.0)


def _points_of(made: Any, radius: float) -> None:
    """Turn an object's vertices into points by geometry nodes."""
    tree = bpy.data.node_groups.new("points", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    points = tree.nodes.new("GeometryNodeMeshToPoints")
    points.inputs["Radius"].default_value = radius
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], points.inputs[0])
    tree.links.new(points.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    made.modifiers.new("points", "NODES").node_group = tree
