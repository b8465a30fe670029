"""Transparency: which surfaces are not there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from agreement.traps.stage import Expect, camera, floor, material, principled, solid, wall

SIDE = 32


def small_picture() -> None:
    """Fewer pixels: transparency takes the judge many renders."""
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 200, 150


def cards(materials: list[Any], kind: str = "plane", **shape: Any) -> None:
    """A row of upright cards with UVs, before the wall, one for each material."""
    small_picture()
    step = 9.0 / len(materials)
    for i, one in enumerate(materials):
        at = (step * (i - (len(materials) - 1) / 2), 0, 1.2)
        card = solid(
            kind, one.name, at, scale=(0.45 * step, 1, 1), turn=(90, 0, 0), material=one, **shape
        )
        scale, offset = one.get("uv", (1.0, 0.0))
        for point in card.data.uv_layers[0].uv:
            point.vector = (point.vector[0] * scale + offset, point.vector[1] * scale + offset)


def leaf_image(name: str = "leaf", alpha: bool = True, outside: float = 0.05) -> Any:
    """An asymmetric leaf, its shape in the alpha channel or as white on black."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] / SIDE - 0.5
    inside = (np.abs(x) < 0.4 * np.cos(2.5 * y)) & (y < 0.42) & ~((x > 0) & (y > 0.1) & (y < 0.25))
    soft = np.where(inside, 0.9, outside + 6 * outside * (x + 0.5))
    pixels = np.ones((SIDE, SIDE, 4), np.float32)
    pixels[..., 3 if alpha else slice(0, 3)] = soft if alpha else soft[..., None]
    image = bpy.data.images.new(name, SIDE, SIDE, alpha=alpha)
    if not alpha:
        image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


def textured(tree: Any, image: Any, **settings: Any) -> Any:
    """An image texture node."""
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    for key, value in settings.items():
        setattr(node, key, value)
    return node


def cut(
    name: str,
    image: Any,
    uv_scale: float = 1.0,
    uv_offset: float = 0.0,
    output: str = "Alpha",
    uv_map: str | None = None,
    **settings: Any,
) -> Any:
    """A material cut out by an image; its card's UVs are scaled and moved: wrapping shows."""

    def build(tree: Any) -> Any:
        shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
        node = textured(tree, image, **settings)
        if uv_map is not None:
            where = tree.nodes.new("ShaderNodeUVMap")
            where.uv_map = uv_map
            tree.links.new(where.outputs[0], node.inputs["Vector"])
        tree.links.new(node.outputs[output], shader.inputs["Alpha"])
        return shader.outputs[0]

    made = material(name, build)
    made["uv"] = (uv_scale, uv_offset)
    return made


def constant_alpha() -> Expect:
    """Alpha just above and below the threshold, and shader mixes with Transparent."""
    wall()
    cards(
        [principled(f"alpha {a}", Alpha=a) for a in (0.3, 0.45, 0.51, 0.7)]
        + [material(f"mix {f}", _mix(f)) for f in (0.3, 0.7)]
        + [material("clear", lambda t: t.nodes.new("ShaderNodeBsdfTransparent").outputs[0])]
    )
    camera(lens=27)
    return Expect(
        seen=("alpha 0.51", "alpha 0.7", "mix 0.7", "Wall"),
        unseen=("alpha 0.3", "alpha 0.45", "mix 0.3", "clear"),
    )


def _mix(factor: float) -> Callable[[Any], Any]:
    def build(tree: Any) -> Any:
        mix = tree.nodes.new("ShaderNodeMixShader")
        mix.inputs[0].default_value = factor
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[2])
        return mix.outputs[0]

    return build


def leaf_cards() -> Expect:
    """Alpha textures under each way to extend and to interpolate them."""
    wall()
    leaf = leaf_image()
    ways = ("REPEAT", "EXTEND", "CLIP", "MIRROR")
    cards(
        [
            cut(f"{way} {how}", leaf, 2.3, -0.6, extension=way, interpolation=how)
            for way in ways
            for how in ("Linear", "Closest")
        ]
    )
    camera((0, -8, 1.2), (0, 0, 1.2), lens=27)
    return Expect(seen=("REPEAT Linear", "EXTEND Closest", "CLIP Linear", "MIRROR Closest"))


def alpha_wirings() -> Expect:
    """Alpha by colour, inverted mix, a second UV map, no UV map at all, no alpha channel."""
    wall()
    leaf, grey = leaf_image(), leaf_image("grey leaf", alpha=False)

    def by_colour(tree: Any) -> Any:
        shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
        tree.links.new(textured(tree, grey).outputs["Color"], shader.inputs["Alpha"])
        return shader.outputs[0]

    def inverted(tree: Any) -> Any:
        mix = tree.nodes.new("ShaderNodeMixShader")
        tree.links.new(textured(tree, leaf).outputs["Alpha"], mix.inputs[0])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[1])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[2])
        return mix.outputs[0]

    cards(
        [
            material("by colour", by_colour),
            material("inverted", inverted),
            cut("second map", leaf, uv_map="second"),
            cut("without map", leaf),
            cut("no alpha channel", grey),
        ]
    )
    second = bpy.data.objects["second map"].data.uv_layers.new(name="second")
    for point in second.uv:
        point.vector = (0.2 + 0.5 * point.vector[1], 0.1 + 0.6 * point.vector[0])
    bare = bpy.data.objects["without map"].data.uv_layers
    bare.remove(bare[0])
    camera((0, -8, 1.2), (0, 0, 1.2), lens=27)
    return Expect(seen=("by colour", "inverted", "second map", "no alpha channel"))


def solid_or_not() -> Expect:
    """Glass, emission, subsurface and empty materials are surfaces; a volume alone is not."""
    small_picture()
    wall()
    floor()

    def fog(tree: Any) -> None:
        output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
        volume = tree.nodes.new("ShaderNodeVolumePrincipled")
        volume.inputs["Density"].default_value = 0.3
        tree.links.new(volume.outputs[0], output.inputs["Volume"])

    made = (
        material("glass", lambda t: t.nodes.new("ShaderNodeBsdfGlass").outputs[0]),
        principled("transmission", Transmission_Weight=1.0, Roughness=0.0),
        material("glow", lambda t: t.nodes.new("ShaderNodeEmission").outputs[0]),
        material("empty", lambda _: None),
        material("fog", fog),
        material("refraction", lambda t: t.nodes.new("ShaderNodeBsdfRefraction").outputs[0]),
    )
    for i, one in enumerate(made):
        solid("cube", one.name, (1.7 * (i - 2.5), 0, 0.9), scale=(0.6, 0.6, 0.6), material=one)
    camera()
    return Expect(seen=("glass", "transmission", "glow", "empty", "refraction"), unseen=("fog",))


def material_links() -> Expect:
    """Slots of the object and of its mesh, an empty slot, and faces with an index too high."""
    small_picture()
    wall()
    clear, opaque = principled("clear", Alpha=0.1), principled("opaque")
    first = solid("cube", "by object", (-3, 0, 1), material=opaque)
    twin = first.copy()
    twin.name, twin.location = "twin by object", (-0.7, 0, 1)
    bpy.context.scene.collection.objects.link(twin)
    twin.material_slots[0].link, twin.material_slots[0].material = "OBJECT", clear
    mixed = solid("cube", "some faces", (1.6, 0, 1), turn=(0, 0, 30), material=opaque)
    mixed.data.materials.append(clear)
    for face in mixed.data.polygons:
        face.material_index = face.index % 2
    wild = solid("cube", "index too high", (4, 0, 1), turn=(0, 0, 30), material=opaque)
    wild.data.materials.append(clear)
    for face in wild.data.polygons:
        face.material_index = 7 if face.index % 2 else 0
    empty = solid("cone", "empty slot", (0.5, -1, 0.5), scale=(0.5, 0.5, 0.5), material=clear)
    empty.material_slots[0].material = None
    camera()
    return Expect(seen=("by object", "some faces", "empty slot"), unseen=("twin by object",))


def layered_cards() -> Expect:
    """Forty transparent cards before one another: more than the usual limit of bounces."""
    small_picture()
    wall()
    leaf = cut("leaf", leaf_image(outside=0.0), interpolation="Closest")
    for i in range(40):
        solid("plane", f"card {i:02}", (0.05 * i, 0.1 * i, 1.2), turn=(90, 0, 3 * i), material=leaf)
    camera((0, -8, 1.2), (0, 0, 1.2), lens=27)
    return Expect(seen=("card 00", "card 39", "Wall"))


TRAPS = (
    constant_alpha,
    leaf_cards,
    alpha_wirings,
    solid_or_not,
    material_links,
    layered_cards,
)
