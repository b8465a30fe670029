"""Who is seen: every switch that takes an object out of a render, or only out of the viewport."""

from __future__ import annotations

import bpy
from agreement.traps.stage import (
    Expect,
    camera,
    collection,
    floor,
    instance_of,
    layer_of,
    material,
    solid,
    unlinked_collection,
    wall,
)


def object_switches() -> Expect:
    """hide_render, hide_viewport, the eye, camera visibility; a wall stands behind all of them."""
    wall()
    solid("cube", "hide_render", (-4, 0, 1)).hide_render = True
    solid("cube", "hide_viewport", (-1.5, 0, 1)).hide_viewport = True
    solid("cube", "eye", (1, 0, 1)).hide_set(True)
    solid("cube", "not for cameras", (3.5, 0, 1)).visible_camera = False
    camera()
    return Expect(seen=("hide_viewport", "eye", "Wall"), unseen=("hide_render", "not for cameras"))


def collection_switches() -> Expect:
    """Excluded, hidden from the render, from the viewport, and only in the layer's eye."""
    wall()
    names = ("excluded", "render", "viewport", "eye")
    for i, name in enumerate(names):
        solid("cube", f"in {name}", (2.5 * (i - 1.5), 0, 1), collection=collection(name))
    layer_of("excluded").exclude = True
    bpy.data.collections["render"].hide_render = True
    bpy.data.collections["viewport"].hide_viewport = True
    layer_of("eye").hide_viewport = True
    inner = collection("inner", bpy.data.collections["render"])
    solid("cone", "in hidden parent", (0, 0, 3), collection=inner)
    twice = solid("cone", "in two", (2, 0, 3), collection=bpy.data.collections["render"])
    bpy.data.collections["viewport"].objects.link(twice)
    camera()
    return Expect(
        seen=("in viewport", "in eye", "in two"),
        unseen=("in excluded", "in render", "in hidden parent"),
    )


def indirect_only() -> Expect:
    """A collection seen by indirect light only, with an instance of it elsewhere."""
    wall()
    away = collection("indirect")
    solid("cube", "indirect cube", (-2, 0, 1), collection=away)
    layer_of("indirect").indirect_only = True
    instance_of(away, "direct again", (4, 0, 0))
    things = unlinked_collection("things")
    solid("cone", "thing", (0, 0, 1), collection=things)
    instance_of(things, "thing indirect", (0, 0, 0), away)
    camera()
    return Expect(seen=("Wall",))


def holdouts() -> Expect:
    """Held out by a collection, by the object, and by its shader; each before the wall."""
    wall()
    held = collection("held")
    solid("cube", "by collection", (-3, 0, 1), collection=held)
    layer_of("held").holdout = True
    solid("uv_sphere", "by object", (0, 0, 1)).is_holdout = True
    hole = material("hole", lambda tree: tree.nodes.new("ShaderNodeHoldout").outputs[0])
    solid("cube", "by shader", (3, 0, 1), material=hole)
    solid("cone", "in front", (-2.4, -2, 1), scale=(0.5, 0.5, 1))
    camera()
    return Expect(seen=("Wall", "in front"))


def held_out_instances() -> Expect:
    """Instances whose instancer is held out, or whose original is."""
    wall()
    held = collection("held")
    layer_of("held").holdout = True
    things = unlinked_collection("things")
    solid("cone", "thing", (0, 0, 1), collection=things)
    instance_of(things, "held thing", (-3, 0, 0), held)
    instance_of(things, "plain thing", (0, 0, 0))
    solid("cube", "held cube", (0, 0, 3), scale=(0.5, 0.5, 0.5), collection=held)
    instance_of(held, "held again", (3, 0, 0))
    solo = unlinked_collection("solo")
    solid("torus", "own holdout", (0, 0, 1), collection=solo).is_holdout = True
    instance_of(solo, "solo again", (3, -1, 0))
    camera()
    return Expect(seen=("Wall", "thing"))


def shadow_catcher() -> Expect:
    """A shadow catcher as a floor."""
    catcher = floor(12)
    catcher.is_shadow_catcher = True
    solid("cube", "cube", (0, 0, 1))
    camera()
    return Expect(seen=("cube",))


def display_types() -> Expect:
    """Objects that the viewport draws as bounds, wire or solid, in front, or without a surface."""
    wall()
    for i, display in enumerate(("BOUNDS", "WIRE", "SOLID", "TEXTURED")):
        solid("monkey", display, (2.4 * (i - 1.5), 0, 1)).display_type = display
    solid("cube", "in front", (0, 9, 1)).show_in_front = True
    camera()
    return Expect(seen=("BOUNDS", "WIRE", "SOLID", "TEXTURED"), unseen=("in front",))


def far_away_camera_ray_switches() -> Expect:
    """Objects that only shadows, reflections or transmission do not see stay."""
    wall()
    for i, ray in enumerate(("diffuse", "glossy", "transmission", "shadow", "volume_scatter")):
        setattr(
            solid("cube", ray, (2.2 * (i - 2), 0, 1), scale=(0.8, 0.8, 0.8)),
            f"visible_{ray}",
            False,
        )
    camera()
    return Expect(seen=("diffuse", "glossy", "transmission", "shadow", "volume_scatter"))


TRAPS = (
    object_switches,
    collection_switches,
    indirect_only,
    holdouts,
    held_out_instances,
    shadow_catcher,
    display_types,
    far_away_camera_ray_switches,
)
