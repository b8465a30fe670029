"""What a file may hold besides one scene: scenes, view layers, linked libraries."""

from __future__ import annotations

from pathlib import Path

import bpy
from agreement.traps.stage import (
    Expect,
    camera,
    collection,
    empty_stage,
    floor,
    instance_of,
    principled,
    solid,
    unlinked_collection,
    wall,
)


def several_scenes() -> Expect:
    """Three scenes, the second active; one object lies in two of them."""
    floor()
    both = solid("cube", "in both", (0, 0, 1))
    solid("cone", "in first", (2, 0, 1))
    camera()
    for name in ("active", "later"):
        made = bpy.data.scenes.new(name)
        made.render.resolution_x, made.render.resolution_y = 320, 240
        made.collection.objects.link(both)
    bpy.context.window.scene = bpy.data.scenes["later"]
    solid("torus", "in later", (0, 0, 1))
    bpy.context.window.scene = bpy.data.scenes["active"]
    solid("monkey", "in active", (-2, 0, 1))
    wall()
    camera((2, -8, 3))
    return Expect(seen=("in both", "in active"), unseen=("in first", "in later"))


def _two_layers() -> None:
    wall()
    for name, x in (("red", -2), ("green", 2)):
        solid("cube", f"{name} cube", (x, 0, 1), collection=collection(name))
    camera()
    layers = bpy.context.scene.view_layers
    layers[0].name = "first"
    second = layers.new("second")
    layers["first"].layer_collection.children["green"].exclude = True
    second.layer_collection.children["red"].exclude = True


def view_layers() -> Expect:
    """Two view layers, the first active: a saved picture shows the first."""
    _two_layers()
    return Expect(seen=("red cube",), unseen=("green cube",))


def view_layers_second_active() -> Expect:
    """Two view layers, the second active: a saved picture still shows the first."""
    _two_layers()
    bpy.context.window.view_layer = bpy.context.scene.view_layers["second"]
    return Expect(seen=("red cube",), unseen=("green cube",))


def view_layers_first_unused() -> Expect:
    """The active view layer is not for rendering: a picture shows the one that is."""
    _two_layers()
    bpy.context.scene.view_layers["first"].use = False
    return Expect(seen=("green cube",), unseen=("red cube",))


def layer_material() -> Expect:
    """A view layer that overrides every material: transparent ones become solid."""
    wall()
    solid("cube", "overridden", (-2, 0, 1), material=principled("clear", Alpha=0.1))
    bpy.context.view_layer.material_override = principled("plain")
    camera()
    return Expect(seen=("overridden", "Wall"))


def linked_library() -> Expect:
    """Objects and an instanced collection linked from another file, with equal names in both."""
    chairs = unlinked_collection("chairs")
    solid("cube", "seat", (0, 0, 1), scale=(0.7, 0.7, 0.1), collection=chairs)
    solid("cylinder", "leg", (0, 0, 0.5), scale=(0.1, 0.1, 0.5), collection=chairs)
    chairs.use_fake_user = True
    solid("monkey", "linked head", (0, 0, 3))
    library = Path.cwd() / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    empty_stage()
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.collections, wanted.objects = ["chairs"], ["linked head"]
    floor()
    wall()
    instance_of(bpy.data.collections["chairs"], "chair left", (-3, 0, 0))
    instance_of(
        bpy.data.collections["chairs"], "chair right", (3, 0, 0), rotation_euler=(0, 0, 0.5)
    )
    bpy.context.scene.collection.objects.link(bpy.data.objects["linked head"])
    solid("cone", "seat", (0, -1, 1))
    camera()
    return Expect(seen=("seat", "leg", "linked head"))


TRAPS = (
    several_scenes,
    view_layers,
    view_layers_second_active,
    view_layers_first_unused,
    layer_material,
    linked_library,
)
