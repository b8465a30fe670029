"""Objects that are not meshes, and meshes without faces."""

from __future__ import annotations

from typing import Any

import bpy
from agreement.traps.stage import (
    Expect,
    camera,
    floor,
    instance_of,
    link,
    solid,
    unlinked_collection,
    wall,
)


def _curve(name: str, at: tuple[float, float, float], **settings: Any) -> Any:
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "3D"
    for key, value in settings.items():
        setattr(data, key, value)
    spline = data.splines.new("BEZIER")
    spline.bezier_points.add(2)
    for point, place in zip(
        spline.bezier_points, ((-1, 0, 0), (0, 0.5, 2), (1, 0, 0.5)), strict=True
    ):
        point.co = place
        point.handle_left_type = point.handle_right_type = "AUTO"
    shown = link(bpy.data.objects.new(name, data))
    shown.location = at
    return shown


def curves() -> Expect:
    """Bevelled, extruded, swept, filled in 2D, and bare; one with its own render resolution."""
    wall()
    _curve("beveled", (-3.5, 0, 0.3), bevel_depth=0.15, resolution_u=2, render_resolution_u=20)
    _curve("extruded", (-1, 0, 0.3), extrude=0.3)
    profile = _curve("profile", (0, 0, -20), dimensions="2D")
    swept = _curve("swept", (1.5, 0, 0.3), bevel_mode="OBJECT", bevel_object=profile)
    swept.scale = (0.5, 0.5, 1)
    bpy.ops.curve.primitive_bezier_circle_add(location=(4, 0, 1.5), rotation=(1.2, 0, 0))
    disc = bpy.context.object
    disc.name, disc.data.dimensions, disc.data.fill_mode = "disc", "2D", "BOTH"
    _curve("bare", (0, -2, 0.5))
    camera()
    return Expect(seen=("beveled", "extruded", "swept", "disc"), unseen=("bare",))


def text() -> Expect:
    """Flat and extruded text, and text with subdivision."""
    wall()
    for i, (body, extrude, bevel) in enumerate(
        (("Flat", 0.0, 0.0), ("Deep", 0.2, 0.0), ("Soft", 0.1, 0.04))
    ):
        data = bpy.data.curves.new(body, "FONT")
        data.body, data.extrude, data.bevel_depth, data.resolution_u = body, extrude, bevel, 3
        data.render_resolution_u = 8
        shown = link(bpy.data.objects.new(body, data))
        shown.location, shown.rotation_euler = (3.1 * (i - 1.45), 0, 1), (1.3, 0, 0.2)
        shown.scale = (1.4, 1.4, 1.4)
    camera()
    return Expect(seen=("Flat", "Deep", "Soft"))


def metaballs() -> Expect:
    """Two families of metaballs, one of three objects, with their own render resolution."""
    wall()
    for family, places in (("blob", (-2.5, -1.6, -0.7)), ("lone", (3.0,))):
        for i, x in enumerate(places):
            data = bpy.data.metaballs.new(family)
            data.resolution, data.render_resolution = 1.0, 0.15
            data.elements.new().radius = 1.2
            shown = link(bpy.data.objects.new(family if i == 0 else f"{family}.{i:03}", data))
            shown.location = (x, 0, 1 + 0.5 * i)
    camera()
    return Expect(seen=("blob", "lone"))


def nurbs() -> Expect:
    """A NURBS sphere and an open NURBS patch."""
    wall()
    bpy.ops.surface.primitive_nurbs_surface_sphere_add(location=(-2, 0, 1.5))
    bpy.context.object.name = "nurbs ball"
    bpy.ops.surface.primitive_nurbs_surface_surface_add(location=(2, 0, 1.5), rotation=(1, 0, 0.5))
    patch = bpy.context.object
    patch.name, patch.data.render_resolution_u = "patch", 9
    camera()
    return Expect(seen=("nurbs ball", "patch"))


def instanced_kinds() -> Expect:
    """A curve, a text and a metaball inside an instanced collection, placed twice."""
    wall()
    pool = unlinked_collection("pool")
    scene = bpy.context.scene.collection
    _curve("wire", (0, 0, 1), bevel_depth=0.1)
    bpy.ops.object.text_add(location=(-0.6, 0, 0.3), rotation=(1.5, 0, 0))
    bpy.context.object.name = "sign"
    bpy.ops.surface.primitive_nurbs_surface_torus_add(location=(0, 0, 2.5))
    bpy.context.object.name = "ring"
    for name in ("wire", "sign", "ring"):
        shown = bpy.data.objects[name]
        scene.objects.unlink(shown)
        link(shown, pool)
    instance_of(pool, "left", (-2.5, 0, 0))
    instance_of(pool, "right", (2.5, 0, 0), scale=(-1, 1, 1))
    camera()
    return Expect(seen=("wire", "sign", "ring"))


def nothing_to_see() -> Expect:
    """Lights, empties, an image empty, a lattice, loose points and edges: none is a surface."""
    floor()
    for kind in ("POINT", "SUN", "SPOT", "AREA"):
        light = link(bpy.data.objects.new(kind, bpy.data.lights.new(kind, kind)))
        light.location, light.scale = (0, -3, 1.5), (2, 2, 2)
    image = link(bpy.data.objects.new("picture", None))
    image.empty_display_type, image.data = "IMAGE", bpy.data.images.new("picture", 8, 8)
    mesh = bpy.data.meshes.new("loose")
    mesh.from_pydata([(0, 0, 0), (1, 0, 3), (-2, 0, 3)], [(0, 1), (1, 2)], [])
    link(bpy.data.objects.new("loose", mesh))
    link(bpy.data.objects.new("no vertex", bpy.data.meshes.new("no vertex")))
    link(bpy.data.objects.new("lattice", bpy.data.lattices.new("lattice")))
    link(bpy.data.objects.new("speaker", bpy.data.speakers.new("speaker")))
    solid("cube", "cube", (2, 0, 1))
    camera()
    return Expect(seen=("Floor", "cube"), unseen=("picture", "loose", "AREA"))


TRAPS = (curves, text, metaballs, nurbs, instanced_kinds, nothing_to_see)
