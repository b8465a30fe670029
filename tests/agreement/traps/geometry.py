"""Shapes, transforms and modifiers."""

from __future__ import annotations

from math import cos, pi, radians, sin
from typing import Any

import bpy
from agreement.traps.stage import Expect, camera, floor, link, polygons, solid, wall

EVERYDAY = ("cube", "uv_sphere", "cylinder", "cone", "torus", "monkey", "ico_sphere")


def mixed_primitives() -> Expect:
    """Seven kinds of solid standing in and before one another."""
    floor()
    wall()
    for i, kind in enumerate(EVERYDAY):
        solid(kind, kind, (1.6 * (i - 3), (i % 3) - 1.0, 0.8), turn=(20 * i, 35 * i, 10))
    camera(lens=30)
    return Expect(seen=(*EVERYDAY, "Floor", "Wall"))


def twisted_scales() -> Expect:
    """Negative, non-uniform and sheared transforms."""
    floor()
    solid("monkey", "mirrored", (-3, 0, 1), scale=(-1, 1, 1))
    solid("monkey", "inverted", (-1, 0, 1), scale=(-1, -0.5, -2))
    solid("monkey", "stretched", (1.5, 0, 1), scale=(0.2, 1.5, 3), turn=(0, 40, 20))
    parent = link(bpy.data.objects.new("shear", None))
    parent.scale, parent.location = (3, 0.5, 1), (3.5, 0, 1)
    child = solid("cube", "sheared", scale=(0.4, 0.4, 0.4), turn=(0, 30, 45))
    child.parent = parent
    camera()
    return Expect(seen=("mirrored", "inverted", "stretched", "sheared"))


def ngons() -> Expect:
    """A concave L, a star with a non-planar rim, and bent quads: all depend on triangulation."""
    polygons(
        "L",
        [(0, 0, 0), (2, 0, 0), (2, 0, 1), (1, 0, 1), (1, 0, 3), (0, 0, 3)],
        [range(6)],
        (-4, 0, 0),
    )
    rim = [
        (
            (2 if i % 2 else 1) * cos(pi * i / 6),
            0.4 * (i % 3),
            1.5 + (2 if i % 2 else 1) * sin(pi * i / 6),
        )
        for i in range(12)
    ]
    polygons("star", rim, [range(12)])
    bent = [(x, 0.6 * ((x + z) % 2), z) for z in range(4) for x in range(4)]
    quads = [
        (4 * r + c, 4 * r + c + 1, 4 * r + c + 5, 4 * r + c + 4) for r in range(3) for c in range(3)
    ]
    polygons("bent", bent, quads, (2.2, 0, 0))
    camera((0, -9, 2), (0, 0, 1.3))
    return Expect(seen=("L", "star", "bent"))


def _modifier(owner: Any, kind: str, **settings: Any) -> Any:
    made = owner.modifiers.new(kind, kind)
    for key, value in settings.items():
        setattr(made, key, value)
    return made


def render_levels() -> Expect:
    """Other subdivision levels in viewport and render, and modifiers of one of the two."""
    floor()
    _modifier(solid("cube", "render3", (-4, 0, 1)), "SUBSURF", levels=0, render_levels=3)
    _modifier(solid("cube", "viewport3", (-1.5, 0, 1)), "SUBSURF", levels=3, render_levels=0)
    off = solid("cube", "render_off", (1, 0, 1))
    _modifier(off, "ARRAY", count=3, show_render=False)
    _modifier(off, "SOLIDIFY", thickness=0.5, show_viewport=False)
    _modifier(
        solid("cube", "viewport_off", (3.5, 0, 1)), "SUBSURF", render_levels=2, show_viewport=False
    )
    camera()
    return Expect(seen=("render3", "viewport3", "render_off", "viewport_off"))


def modifiers() -> Expect:
    """Boolean with a hidden cutter, mirror, array, bevel, displacement, decimation."""
    floor()
    cutter = solid("uv_sphere", "cutter", (-3.5, -0.8, 1.5), scale=(0.9, 0.9, 0.9))
    cutter.hide_render, cutter.display_type = True, "WIRE"
    _modifier(solid("cube", "cut", (-3.5, 0, 1)), "BOOLEAN", object=cutter, operation="DIFFERENCE")
    half = solid("cone", "mirrored", (-0.5, 0, 1), scale=(0.5, 0.5, 1))
    for vertex in half.data.vertices:
        vertex.co.x += 1
    _modifier(half, "MIRROR", use_axis=(True, False, False))
    _modifier(half, "ARRAY", count=2, relative_offset_displace=(0, 1.2, 0.3))
    _modifier(
        solid("cube", "beveled", (2.2, 0, 0.8), scale=(0.8, 0.8, 0.8)),
        "BEVEL",
        width=0.3,
        segments=3,
    )
    waved = solid(
        "grid", "waved", (4.5, 0, 1), x_subdivisions=20, y_subdivisions=20, turn=(50, 0, 0)
    )
    _modifier(waved, "WAVE", height=0.4, width=0.8)
    _modifier(waved, "DECIMATE", ratio=0.4)
    camera()
    return Expect(seen=("cut", "mirrored", "beveled", "waved"), unseen=("cutter",))


def deformed() -> Expect:
    """A shape key, a lattice and an armature."""
    floor()
    keyed = solid("uv_sphere", "keyed", (-3, 0, 1))
    keyed.shape_key_add(name="Basis")
    tall = keyed.shape_key_add(name="tall")
    for point in tall.data:
        point.co.z *= 2.5
    tall.value = 0.7
    lattice = link(bpy.data.objects.new("lattice", bpy.data.lattices.new("lattice")))
    lattice.location, lattice.scale = (0, 0, 1), (2, 2, 2)
    lattice.data.points_u = lattice.data.points_v = lattice.data.points_w = 2
    lattice.data.points[7].co_deform.x += 1
    bent = solid("cube", "latticed", (0, 0, 1))
    _modifier(bent, "SUBSURF", render_levels=3, subdivision_type="SIMPLE")
    _modifier(bent, "LATTICE", object=lattice)
    _armed()
    camera()
    return Expect(seen=("keyed", "latticed", "armed"))


def _armed() -> None:
    bones = link(bpy.data.objects.new("bones", bpy.data.armatures.new("bones")))
    bones.location = (3, 0, 0)
    bpy.context.view_layer.objects.active = bones
    bpy.ops.object.mode_set(mode="EDIT")
    bone = bones.data.edit_bones.new("bone")
    bone.head, bone.tail = (0, 0, 0), (0, 0, 2)
    bpy.ops.object.mode_set(mode="OBJECT")
    bones.pose.bones["bone"].rotation_mode = "XYZ"
    bones.pose.bones["bone"].rotation_euler = (0.3, 0, radians(50))
    armed = solid("cylinder", "armed", (3, 0, 1))
    armed.vertex_groups.new(name="bone").add(list(range(len(armed.data.vertices))), 1.0, "REPLACE")
    _modifier(armed, "ARMATURE", object=bones)


TRAPS = (mixed_primitives, twisted_scales, ngons, render_levels, modifiers, deformed)
