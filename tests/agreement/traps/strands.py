"""Hair curves and points: what Cycles draws without a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, sin
from typing import Any

import bpy
import numpy as np
from agreement.traps.particle_hair import hairy
from agreement.traps.stage import (
    Expect,
    Triple,
    camera,
    instance_of,
    link,
    material,
    polygons,
    principled,
    solid,
    unlinked_collection,
    wall,
)


def fur(
    name: str,
    curves: Sequence[Sequence[Triple]],
    radius: Callable[[int, float], float] | float | None,
    at: Triple = (0, 0, 0),
    collection: Any = None,
) -> Any:
    """A hair curves object; radius: of (curve, share of the way), of all, None: no attribute."""
    data = bpy.data.hair_curves.new(name)
    data.add_curves([len(c) for c in curves])
    points = np.array([p for c in curves for p in c], np.float32)
    data.position_data.foreach_set("vector", points.ravel())
    if radius is not None:
        places = [(i, j / max(1, len(c) - 1)) for i, c in enumerate(curves) for j in range(len(c))]
        values = [radius(*place) if callable(radius) else radius for place in places]
        data.attributes.new("radius", "FLOAT", "POINT").data.foreach_set(
            "value", np.array(values, np.float32)
        )
    made = link(bpy.data.objects.new(name, data), collection)
    made.location = at
    return made


def curl(at: Triple, size: float, keys: int = 9, turns: float = 1.2) -> list[Triple]:
    """A strand that winds upwards."""
    x, y, z = at
    return [
        (x + size * cos(a), y + size * sin(a), z + 2.2 * i / keys)
        for i, a in ((i, 2 * pi * turns * i / keys) for i in range(keys))
    ]


def _forest(name: str = "fur", at: Triple = (0, 0, 0)) -> Any:
    strands = [curl((0.8 * i - 3.2, 0.6 * (i % 3), 0), 0.25 + 0.02 * i) for i in range(9)]
    strands += [[(x, -1.5, 0.0), (x + 0.3, -1.5, 1.5)] for x in (-3.0, 0.0, 2.5)]
    strands += [[(1.2, -2, 0.1)], [(-1, -2, 0), (-1, -2, 0.5), (-1.2, -2, 1)]]
    return fur(name, strands, lambda i, t: (0.03 + 0.01 * (i % 4)) * (1 - 0.7 * t), at)


def ribbons() -> Expect:
    """Curled and straight strands of several lengths as ribbons, with the default subdivisions."""
    wall()
    _forest()
    camera()
    return Expect(seen=("fur",))


def finest_ribbons() -> Expect:
    """17 quads between two keys, one more than Embree makes, seen orthographically."""
    wall()
    _forest()
    bpy.context.scene.cycles_curves.subdivisions = 4
    camera(type="ORTHO", ortho_scale=9)
    return Expect(seen=("fur",))


def coarsest_ribbons() -> Expect:
    """Two quads between two keys: curls become angular."""
    wall()
    _forest()
    bpy.context.scene.cycles_curves.subdivisions = 0
    camera()
    return Expect(seen=("fur",))


def wide_ribbons() -> Expect:
    """Ribbons a tenth as wide as they are far away: the turn towards each ray shows."""
    wall()
    fur("fur", [curl((x, 0, 0), 0.5, turns=0.5) for x in (-3, 0, 3)], lambda _, t: 0.3 + 0.2 * t)
    camera((0, -6, 2), lens=24)
    return Expect(seen=("fur",))


def thick() -> Expect:
    """Round strands, open at their ends."""
    wall()
    _forest()
    bpy.context.scene.cycles_curves.shape = "THICK"
    camera()
    return Expect(seen=("fur",))


def thick_linear() -> Expect:
    """Cones between keys, with spheres at the keys."""
    wall()
    _forest()
    bpy.context.scene.cycles_curves.shape = "THICK_LINEAR"
    camera()
    return Expect(seen=("fur",))


def poly_curves() -> Expect:
    """Hair curves of straight pieces are round whatever the scene says."""
    wall()
    _forest().data.set_types(type="POLY")
    camera()
    return Expect(seen=("fur",))


def no_radius() -> Expect:
    """Curves without a radius attribute, and one with a radius per curve."""
    wall()
    near = [[(0.1 * i - 0.5, 0, 0), (0.1 * i - 0.5, 0, 0.3), (0.1 * i - 0.4, 0, 0.6)]
            for i in range(8)]  # fmt: skip
    fur("plain", near, None)
    other = fur("by curve", near, None, (0, 0, 0.65))
    other.data.attributes.new("radius", "FLOAT", "CURVE").data.foreach_set(
        "value", np.linspace(0.005, 0.02, 8).astype(np.float32)
    )
    camera((0, -2.2, 0.6), (0, 0, 0.6))
    return Expect(seen=("plain", "by curve"))


def placed_fur() -> Expect:
    """Scaled, sheared, mirrored, instanced and moved hair curves."""
    wall()
    pool = unlinked_collection("pool")
    fur("fur", [curl((0.5 * i, 0, 0), 0.2) for i in range(3)], 0.04, collection=pool)
    instance_of(pool, "plain", (-4, 0, 0))
    instance_of(pool, "uneven", (-2, 0, 0), scale=(1, 0.4, 0.6))
    instance_of(pool, "mirrored", (2.5, 0, 0), scale=(-1, 1, 1))
    parent = instance_of(pool, "turned", (3, 1, 0), rotation_euler=(0.3, 0.2, 0.4))
    parent.scale = (1, 2, 0.5)
    instance_of(pool, "sheared", (0, 0, 0), rotation_euler=(0, 0.5, 0.5)).parent = parent
    camera()
    return Expect(seen=("fur",))


def hair_layer_off() -> Expect:
    """A view layer that renders no hair."""
    wall()
    _forest()
    hairy("ball", (0, -2, 1))
    bpy.context.view_layer.use_strand = False
    camera()
    return Expect(seen=("ball",), unseen=("fur",))


def _tree(name: str) -> tuple[Any, Any, Any]:
    """A geometry node tree, the socket geometry comes from and the one it goes to."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    source = tree.nodes.new("NodeGroupInput").outputs[0]
    return tree, source, tree.nodes.new("NodeGroupOutput").inputs[0]


def node_curves() -> Expect:
    """Hair changed and scattered by nodes, of three materials; curves nodes make of a mesh."""
    wall()
    for name, x in (("groomed", -4), ("air", -1.5), ("hole", 0.5)):
        strands = [[(0.2 * i, 0, 0), (0.2 * i, 0.3, 1), (0.2 * i, 0, 2)] for i in range(6)]
        made = fur(name, strands, 0.02, (x, 0, 0))
        tree, source, target = _tree(name)
        thick = tree.nodes.new("GeometryNodeSetCurveRadius")
        thick.inputs["Radius"].default_value = 0.05
        tree.links.new(source, thick.inputs["Curve"])
        tree.links.new(thick.outputs[0], target)
        made.modifiers.new("nodes", "NODES").node_group = tree
    bpy.data.objects["air"].data.materials.append(principled("air", Alpha=0.3))
    bpy.data.objects["hole"].data.materials.append(
        material("hole", lambda tree: tree.nodes.new("ShaderNodeHoldout").outputs[0])
    )
    _scattered_fur()
    tree, _, target = _tree("spiral")
    tree.links.new(tree.nodes.new("GeometryNodeCurveSpiral").outputs[0], target)
    solid("cube", "spiral", (3, 0, 1)).modifiers.new("nodes", "NODES").node_group = tree
    camera()
    return Expect(seen=("groomed", "blade"), unseen=("air", "hole", "spiral"))


def _scattered_fur() -> None:
    """A tuft on each vertex of a grid, by nodes."""
    tuft = fur("blade", [[(0, 0, 0), (0.1, 0, 0.3), (0.3, 0, 0.5)]], 0.03)
    tuft.hide_render = True
    tree, source, target = _tree("scatter")
    place = tree.nodes.new("GeometryNodeInstanceOnPoints")
    info = tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = tuft
    info.inputs["As Instance"].default_value = True
    tree.links.new(source, place.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], place.inputs["Instance"])
    tree.links.new(place.outputs[0], target)
    ground = solid("grid", "ground", (3, -1, 0), x_subdivisions=3, y_subdivisions=3)
    ground.modifiers.new("nodes", "NODES").node_group = tree


def node_points(name: str, count: int, radius: float, span: float) -> Any:
    """A node tree that makes a cloud of points at random places."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    points, chance = tree.nodes.new("GeometryNodePoints"), tree.nodes.new("FunctionNodeRandomValue")
    points.inputs["Count"].default_value, points.inputs["Radius"].default_value = count, radius
    chance.data_type = "FLOAT_VECTOR"
    chance.inputs["Max"].default_value = (span, span, span)
    tree.links.new(chance.outputs["Value"], points.inputs["Position"])
    tree.links.new(points.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    return tree


def point_clouds() -> Expect:
    """Points of three sizes, scaled unevenly, instanced, near the camera, and see-through."""
    wall()
    pool = unlinked_collection("pool")
    for name, count, radius, at in (
        ("fine", 400, 0.02, (-4, 0, 0)),
        ("coarse", 20, 0.2, (-1.5, 0, 0)),
        ("oval", 20, 0.15, (1, 0, 0)),
        ("close", 3, 0.1, (-0.4, -8.5, 3.2)),
        ("clear", 20, 0.3, (3, -1, 0)),
    ):
        cloud = polygons(name, [], [], at)
        span = 0.4 if name == "close" else 2.0
        cloud.modifiers.new("nodes", "NODES").node_group = node_points(name, count, radius, span)
    bpy.data.objects["oval"].scale = (1, 0.5, 1.4)
    clear = bpy.data.node_groups["clear"]
    tint = clear.nodes.new("GeometryNodeSetMaterial")
    tint.inputs["Material"].default_value = principled("air", Alpha=0.1)
    output = next(n for n in clear.nodes if n.type == "GROUP_OUTPUT")
    clear.links.new(output.inputs[0].links[0].from_socket, tint.inputs["Geometry"])
    clear.links.new(tint.outputs[0], output.inputs[0])
    inner = polygons("inner", [], [])
    inner.modifiers.new("nodes", "NODES").node_group = node_points("inner", 15, 0.1, 1.0)
    bpy.context.scene.collection.objects.unlink(inner)
    link(inner, pool)
    instance_of(pool, "one", (3, 0, 0.5))
    instance_of(pool, "other", (4.5, 0, 1), scale=(-1, 1, 0.5))
    camera()
    return Expect(seen=("fine", "coarse", "oval", "close", "inner"), unseen=("clear",))


TRAPS = (
    ribbons,
    finest_ribbons,
    coarsest_ribbons,
    wide_ribbons,
    thick,
    thick_linear,
    poly_curves,
    no_radius,
    placed_fur,
    hair_layer_off,
    node_curves,
    point_clouds,
)
