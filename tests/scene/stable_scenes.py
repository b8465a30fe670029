"""The same scene built twice in another order, and saved twice."""

from __future__ import annotations

import time

import bpy
import numpy as np
from cases.stage import box, collection, instance_of, link, material, pixel_camera, square


def saved_once() -> None:
    _scene(reverse=False)


def saved_later() -> None:
    time.sleep(1.1)  # file times are kept in seconds
    _scene(reverse=False)


def built_in_another_order() -> None:
    bpy.ops.mesh.primitive_cube_add()  # datablocks that come and go
    bpy.data.objects.remove(bpy.context.object)
    _scene(reverse=True)


def _scene(*, reverse: bool) -> None:
    pixel_camera()
    steps = [_boxes, _instances, _cards, _shared]
    for step in reversed(steps) if reverse else steps:
        step(-1 if reverse else 1)


def _boxes(order: int) -> None:
    group = collection("Boxes", category="box")
    for i in range(6)[::order]:
        made = box(f"Box {i}", 10 * i, 0, 10 * i + 8, 8, collection=group)
        labels = {"lvis_category": "crate", "category": f"thing {i}"}
        for key in list(labels)[::order]:
            made[key] = labels[key]


def _instances(order: int) -> None:
    stool = collection("Stool", None)
    for name in ("Seat", "Leg")[::order]:
        square(name, 3, stool)
    for i in range(4)[::order]:
        instance_of(stool, f"Place {i}", 10 + 15 * i, 20)


def _cards(order: int) -> None:
    for i in range(3)[::order]:
        image = bpy.data.images.new(f"alpha {i}", 2, 2, alpha=True)
        image.pixels.foreach_set(np.linspace(0, 1, 16, dtype=np.float32) * (i + 1) / 3)
        image.pack()
        card = box(f"Card {i}", 20 * i, 30, 20 * i + 16, 40)
        card.data.uv_layers.new(name="UVMap")
        tree = material(f"card {i}", card).node_tree
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = image
        alpha = tree.nodes["Principled BSDF"].inputs["Alpha"]
        tree.links.new(texture.outputs["Alpha"], alpha)


def _shared(order: int) -> None:
    names = ["One", "Two"][::order]
    first = square(names[0], 5)
    second = link(bpy.data.objects.new(names[1], first.data))
    first.data.name = "Shared"
    for made in (first, second):
        made.location.x = 20 if made.name == "One" else -20
