"""Scenes of rows 22 to 25 and 27: what a render shows of an object."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from cases.stage import (
    at,
    box,
    collection,
    empty,
    instance_of,
    link,
    material,
    pixel_camera,
    polygons,
    square,
    world_xy,
)


def render_levels() -> None:
    pixel_camera()
    subdivided = at(square("Subdivided", 20, category="thing"), 20, 30)
    levels = subdivided.modifiers.new("Subdivision", "SUBSURF")
    levels.levels, levels.render_levels, levels.subdivision_type = 0, 3, "SIMPLE"
    wider = at(square("Not widened", 10, category="thing"), 60, 30)
    double = wider.modifiers.new("Array", "ARRAY")
    double.show_render = False
    hidden = at(square("Widened", 10, category="thing"), 55, 10)
    double = hidden.modifiers.new("Array", "ARRAY")
    double.show_viewport = False


def switches() -> None:
    pixel_camera()
    for i, (name, switch) in enumerate(
        {
            "hide_render": {"hide_render": True},
            "hide_viewport": {"hide_viewport": True},
            "camera off": {"visible_camera": False},
            "shadow off": {"visible_shadow": False},
        }.items()
    ):
        made = box(name, 20 * i, 0, 20 * i + 15, 15, z=1, category="thing")
        for key, value in switch.items():
            setattr(made, key, value)
        box(f"behind {name}", 20 * i, 0, 20 * i + 15, 15)
    layer = bpy.context.view_layer.layer_collection
    for i, (name, switch) in enumerate(
        {
            "excluded": {"exclude": True},
            "indirect": {"indirect_only": True},
            "holdout": {"holdout": True},
            "holdout and indirect": {"holdout": True, "indirect_only": True},
        }.items()
    ):
        group = collection(f"in {name}")
        box(name, 20 * i, 20, 20 * i + 15, 35, z=1, collection=group, category="thing")
        box(f"behind {name}", 20 * i, 20, 20 * i + 15, 35)
        for key, value in switch.items():
            setattr(layer.children[group.name], key, value)
    eye = box("eye closed", 0, 40, 15, 55, category="thing")
    eye.hide_set(True)
    group = collection("hidden from renders")
    box("in a hidden collection", 20, 40, 35, 55, collection=group, category="thing")
    group.hide_render = True
    group = collection("hidden in viewports")
    box("in a viewport-hidden collection", 40, 40, 55, 55, collection=group, category="thing")
    group.hide_viewport = True
    parent = box("hidden parent", 60, 40, 61, 41, category="thing")
    parent.hide_render = True
    box("child of a hidden one", 62, 40, 75, 55).parent = parent


def instanced_switches() -> None:
    """Cycles asks the shown object and its outermost instancer, and nothing between."""
    pixel_camera()
    source = collection("Source", None)
    square("Plain", 8, source, category="thing")
    held = collection("Held", None)
    square("Held out inside", 8, held, category="thing").is_holdout = True
    unseen = collection("Unseen", None)
    square("Camera off inside", 8, unseen, category="thing").visible_camera = False
    instance_of(held, "Shows its holdout", 10, 10)
    instance_of(unseen, "Shows no camera-off", 30, 10)
    instance_of(source, "Camera off", 50, 10).visible_camera = False
    instance_of(source, "Held out", 70, 10).is_holdout = True
    middle = collection("Middle", None)
    instance_of(source, "Camera off between", 40, 30, middle).visible_camera = False
    instance_of(middle, "Outer", 10 + 30, 30 + 10)
    box("Ground", 0, 0, 80, 60, z=-1)


def shown_instancers() -> None:
    pixel_camera()
    for i, show in enumerate((True, False)):
        x, y = 20 + 40 * i, 30
        plate = at(square(f"Plate {show}", 20, category="plate"), x, y)
        plate.instance_type, plate.show_instancer_for_render = "VERTS", show
        plate.show_instancer_for_viewport = not show
        square(f"Dot {show}", 4, category="dot").parent = plate


def wall() -> None:
    pixel_camera()
    box("Chair", 10, 10, 50, 50, category="chair")
    box("Wall", 30, 0, 80, 60, z=1)


def constant_alpha() -> None:
    pixel_camera()
    for i, alpha in enumerate((0.0, 0.3, 0.49, 0.5, 0.7, 1.0)):
        card = box(f"alpha {alpha}", 10 * i, 0, 10 * i + 8, 10, z=1, category="card")
        material(f"alpha {alpha}", card, Alpha=alpha)
    material("glass", box("Glass", 0, 20, 20, 30, z=1, category="card"), Transmission_Weight=1.0)
    fog = material("fog", box("Fog", 30, 20, 50, 30, z=1, category="card"))
    fog.node_tree.nodes.remove(fog.node_tree.nodes["Principled BSDF"])
    volume = fog.node_tree.nodes.new("ShaderNodeVolumePrincipled")
    output = fog.node_tree.nodes["Material Output"]
    fog.node_tree.links.new(volume.outputs[0], output.inputs["Volume"])
    void = material("nothing linked", box("Void", 55, 20, 75, 30, z=1, category="card"))
    void.node_tree.nodes.remove(void.node_tree.nodes["Principled BSDF"])
    two = polygons(
        "Half",
        [
            (*world_xy(x, y), 1.0)
            for x, y in [(0, 50), (20, 50), (40, 50), (40, 40), (20, 40), (0, 40)]
        ],
        [(0, 1, 4, 5), (1, 2, 3, 4)],
        category="card",
    )
    material("left", two, Alpha=0.0)
    material("right", two)
    two.data.polygons[1].material_index = 1
    box("Wall", 0, 0, 80, 60)


_Wire = Callable[[Any, Any], Any]  # (node tree, image node) -> socket that carries alpha


def _card(name: str, x: float, y: float, image: Any, wire: _Wire, **settings: Any) -> Any:
    """A 16 x 16 card whose alpha comes from an image, one texel to four by four pixels."""
    card = box(name, x, y, x + 16, y + 16, z=1, category="card")
    uv = card.data.uv_layers.new(name="UVMap")
    uv.uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    shader = material(name, card)
    tree = shader.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image, texture.interpolation = image, "Closest"
    for key, value in settings.items():
        setattr(texture, key, value)
    tree.links.new(wire(tree, texture), tree.nodes["Principled BSDF"].inputs["Alpha"])
    return card


def _alpha(_: Any, texture: Any) -> Any:
    return texture.outputs["Alpha"]


def _color(_: Any, texture: Any) -> Any:
    return texture.outputs["Color"]


def _math(operation: str, first: float | None, second: float | None) -> _Wire:
    def wire(tree: Any, texture: Any) -> Any:
        node = tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, (first, second), strict=False):
            if value is None:
                tree.links.new(texture.outputs["Alpha"], socket)
            else:
                socket.default_value = value
        return node.outputs[0]

    return wire


def _gltf_clip(tree: Any, texture: Any) -> Any:
    """1 - (alpha < 0.25), the way the glTF importer writes a mask."""
    below = _math("LESS_THAN", None, 0.25)(tree, texture)
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = "SUBTRACT"
    node.inputs[0].default_value = 1.0
    tree.links.new(below, node.inputs[1])
    return node.outputs[0]


def _mapped(tree: Any, texture: Any) -> Any:
    """The picture turned by 90 degrees about its lower left corner and moved back into place."""
    coordinates, mapping = (
        tree.nodes.new("ShaderNodeTexCoord"),
        tree.nodes.new("ShaderNodeMapping"),
    )
    mapping.inputs["Rotation"].default_value[2] = math.pi / 2
    mapping.inputs["Location"].default_value[0] = 1.0
    tree.links.new(coordinates.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    return texture.outputs["Alpha"]


def _noise(tree: Any, _: Any) -> Any:
    return tree.nodes.new("ShaderNodeTexNoise").outputs[0]


def _light_path(fact: str) -> _Wire:
    def wire(tree: Any, _: Any) -> Any:
        return tree.nodes.new("ShaderNodeLightPath").outputs[fact]

    return wire


def _picture(name: str, alpha: np.ndarray) -> Any:
    """A packed picture with this alpha, top row first, and white colour."""
    height, width = alpha.shape
    image = bpy.data.images.new(name, width, height, alpha=True)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., 3] = alpha[::-1]
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


def image_alpha() -> None:
    pixel_camera()
    # 4 x 4 texels; the first row is the top one.
    alpha = np.array([[0, 1, 1, 1], [1, 0, 0.3, 1], [1, 1, 0, 0.3], [0.3, 1, 1, 0]], np.float32)
    leaf = _picture("leaf", alpha)
    grey = bpy.data.images.new("grey", 4, 4, alpha=False, is_data=True)
    pixels = np.ones((4, 4, 4), np.float32)
    pixels[..., :3] = alpha[::-1, :, None]
    grey.pixels.foreach_set(pixels.ravel())
    grey.pack()
    _card("as it is", 0, 0, leaf, _alpha)
    _card("colour", 20, 0, grey, _color)
    _card("inverted", 40, 0, leaf, _math("SUBTRACT", 1.0, None))
    _card("over 0.2", 60, 0, leaf, _math("GREATER_THAN", None, 0.2))
    _card("gltf mask", 0, 20, leaf, _gltf_clip)
    _card("over 0", 20, 20, leaf, _math("GREATER_THAN", None, 0.0))
    _card("half", 40, 20, leaf, _math("MULTIPLY", None, 0.49))
    _card("turned", 60, 20, leaf, _mapped)
    _card("noise", 0, 40, leaf, _noise)
    _card("camera ray", 60, 40, leaf, _light_path("Is Camera Ray"))
    _card("shadow ray", 60, 40, leaf, _light_path("Is Shadow Ray"))
    missing = bpy.data.images.new("gone", 4, 4)
    missing.source, missing.filepath = "FILE", "//gone.png"
    _card("missing", 20, 40, missing, _alpha)
    _card("no map", 40, 40, leaf, _alpha).data.uv_layers.remove(
        bpy.data.meshes["no map"].uv_layers[0]
    )


def material_links() -> None:
    """The object's own material wins over its mesh's; the layer's override over both."""
    pixel_camera()
    mesh_gone = box("Object's material", 10, 10, 30, 30, category="thing")
    material("gone", mesh_gone, Alpha=0.0)
    mesh_gone.material_slots[0].link = "OBJECT"
    mesh_gone.material_slots[0].material = bpy.data.materials.new("solid")
    curve = bpy.data.curves.new("Curve", "CURVE")
    curve.dimensions, curve.fill_mode = "2D", "BOTH"
    spline = curve.splines.new("POLY")
    spline.points.add(3)
    spline.use_cyclic_u = True
    for point, (x, y) in zip(spline.points, [(0, 0), (8, 0), (8, 8), (0, 8)], strict=True):
        point.co = (x, y, 0, 1)
    curve.materials.append(bpy.data.materials["gone"])
    made = at(link(bpy.data.objects.new("Curve", curve)), 50, 30)
    made["category"] = "thing"
    made.material_slots[0].link = "OBJECT"
    made.material_slots[0].material = bpy.data.materials["solid"]


def material_override() -> None:
    pixel_camera()
    material("gone", box("Card", 10, 10, 30, 30, category="thing"), Alpha=0.0)
    bpy.context.view_layer.material_override = bpy.data.materials.new("solid")


def holdout_shader() -> None:
    pixel_camera()
    two = polygons(
        "Half",
        [
            (*world_xy(x, y), 1.0)
            for x, y in [(0, 50), (20, 50), (40, 50), (40, 40), (20, 40), (0, 40)]
        ],
        [(0, 1, 4, 5), (1, 2, 3, 4)],
        category="card",
    )
    hole = material("hole", two)
    tree = hole.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    shader = tree.nodes.new("ShaderNodeHoldout")
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    material("solid", two)
    two.data.polygons[1].material_index = 1
    box("Wall", 0, 0, 80, 60)


def scales() -> None:
    pixel_camera()
    mirrored = at(square("Mirrored", 10, category="thing"), 10, 10)
    mirrored.scale = (-1, 1, 1)
    stretched = at(square("Stretched", 10, category="thing"), 40, 30)
    stretched.scale = (3, 0.4, -2)
    flipped = at(square("Back face", 10, category="thing"), 70, 10)
    flipped.rotation_euler[0] = math.pi
    parent = empty("Skewing parent")
    at(parent, 20, 45).scale = (2, 1, 1)
    child = square("Skewed", 10, category="thing")
    child.parent = parent
    child.rotation_euler[2] = math.pi / 4
