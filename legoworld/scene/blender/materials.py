"""The alpha rule of a material, read from its shader nodes: which surfaces are removed.

Alpha below `ALPHA_THRESHOLD` removes the surface: all of it where alpha is constant, sample by
sample where it comes from an image through a UV map, from an attribute of the mesh, or from their
product (as it is, inverted, scaled, or compared with a constant). It may be another rule on the
back of a surface. Glass and other transmission is a surface; a material with only a volume is not
one. What the rule cannot read is opaque, with a warning that names the material.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD, TAKEN_AS_OPAQUE
from legoworld.scene.blender.alpha_attributes import LUMINANCE_RGB, AttributeSource
from legoworld.scene.blender.alpha_images import ImageSource
from legoworld.scene.blender.alpha_values import (
    Curve,
    ProductSource,
    SidedValue,
    Value,
    clamp,
    lift_operation,
    read_value,
)
from legoworld.scene.blender.shader_links import Feed, UnreadableAlphaError, find_feed

if TYPE_CHECKING:
    import bpy

#: Steps of 0..1 in which alpha is searched for its cut; a picture has 255.
_GRID: Final = 255 * 4

Whole = Literal["there", "gone", "holdout"]
"""A surface everywhere alike; a holdout hides what is behind it and is not seen itself."""


@dataclass(frozen=True, kw_only=True)
class ImageAlpha:
    """The surface is there where the image value is >= cut (<= cut, when not `above`)."""

    source: ImageSource
    cut: float
    above: bool


@dataclass(frozen=True, kw_only=True)
class AttributeAlpha:
    """The surface is there where `of` the source's value is >= `ALPHA_THRESHOLD`.

    Where that is depends on the values a mesh has: see `cut_meshes`.
    """

    source: AttributeSource | ProductSource
    of: Callable[[float], float]


OneSided = Whole | ImageAlpha | AttributeAlpha


@dataclass(frozen=True, kw_only=True)
class SidedAlpha:
    """One rule for the front of a surface, another for its back."""

    front: OneSided
    back: OneSided


AlphaRule = OneSided | SidedAlpha


def material_rule(material: bpy.types.Material) -> tuple[AlphaRule, list[str]]:
    """Where a material's surface is there, and warnings for what could not be read."""
    if material is None or material.node_tree is None:
        return "there", []
    output = material.node_tree.get_output_node("CYCLES")
    if output is None:
        return "there", []
    warnings = []
    if output.inputs["Displacement"].is_linked and material.displacement_method != "BUMP":
        warnings.append(f"material {material.name!r} displaces its surface: read undisplaced")
    surface, volume = output.inputs["Surface"], output.inputs["Volume"]
    if not surface.is_linked:
        return ("gone" if volume.is_linked else "there"), warnings
    try:
        shader = find_feed(surface)
        if shader.node is not None and shader.node.type == "HOLDOUT":
            return "holdout", warnings
        return alpha_rule(_shader_alpha(shader)), warnings
    except UnreadableAlphaError as error:
        warnings.append(f"material {material.name!r}: {error}; its surface is {TAKEN_AS_OPAQUE}")
        return "there", warnings


def image_value(image: bpy.types.Image, source: ImageSource) -> NDArray[np.float32] | None:
    """(H, W) float32 of one channel, top row first; None when the image has no pixels."""
    width, height = image.size
    if width == 0 or height == 0:
        return None
    pixels = np.empty(width * height * image.channels, np.float32)
    try:
        image.pixels.foreach_get(pixels)
    except RuntimeError:  # the file is missing or no picture, though its size is on record
        return None
    rgba = pixels.reshape(height, width, image.channels)[::-1]
    if image.channels == 4 and image.alpha_mode != "NONE":
        alpha = rgba[..., 3]
    else:
        alpha = np.ones((height, width), np.float32)
    if source.channel == "alpha":
        return alpha
    luminance = _luminance(rgba, image.colorspace_settings.name)
    return luminance * alpha if source.channel == "premultiplied" else luminance


def bake_alpha(value: NDArray[np.float32], rule: ImageAlpha) -> NDArray[np.uint8]:
    """An image value turned into the alpha that `ALPHA_THRESHOLD` cuts where the rule does.

    Both (H, W). The change is linear around the cut, so that it commutes with linear interpolation.
    """
    gain = 0.5 / max(rule.cut, 1.0 - rule.cut)
    exact = value.astype(np.float64)
    there = exact >= rule.cut if rule.above else exact <= rule.cut
    alpha = ALPHA_THRESHOLD + gain * (exact - rule.cut) * (1.0 if rule.above else -1.0)
    steps = np.rint(np.clip(alpha, 0.0, 1.0) * 255.0)
    return np.where(there, np.maximum(steps, 128.0), np.minimum(steps, 127.0)).astype(np.uint8)


def alpha_rule(alpha: Value) -> AlphaRule:
    """Where alpha reaches `ALPHA_THRESHOLD`. Raises UnreadableAlphaError unless one cut says it."""
    if not isinstance(alpha, SidedValue):
        return one_sided_rule(alpha)
    front, back = one_sided_rule(alpha.front), one_sided_rule(alpha.back)
    return front if front == back else SidedAlpha(front=front, back=back)


def one_sided_rule(alpha: float | Curve) -> OneSided:
    """`alpha_rule` of a value that is the same on both sides. UnreadableAlphaError."""
    if isinstance(alpha, float):
        return "there" if alpha >= ALPHA_THRESHOLD else "gone"
    if not isinstance(alpha.source, ImageSource):
        return AttributeAlpha(source=alpha.source, of=alpha.of)
    cut = find_cut(alpha.of, 0.0, 1.0)
    if isinstance(cut, str):
        return cut
    if alpha.source.wrap == "clip" and not cut.above:
        raise UnreadableAlphaError("alpha is an inverted image that is clipped at its border")
    return ImageAlpha(source=alpha.source, cut=cut.at, above=cut.above)


@dataclass(frozen=True, kw_only=True)
class ValueCut:
    """A surface is there where a value is >= `at` (<= `at`, when not `above`)."""

    at: float
    above: bool


def find_cut(
    of: Callable[[float], float], low: float, high: float
) -> Literal["there", "gone"] | ValueCut:
    """Where in low..high `of` reaches `ALPHA_THRESHOLD`.

    Raises UnreadableAlphaError where it does so more than once.
    """
    values = [low + (high - low) * (i / _GRID) for i in range(_GRID + 1)]
    there = [of(value) >= ALPHA_THRESHOLD for value in values]
    changes = [i for i in range(_GRID) if there[i] != there[i + 1]]
    if not changes:
        return "there" if there[0] else "gone"
    if len(changes) > 1:
        raise UnreadableAlphaError(
            "alpha is not a rising or falling function of what it is read of"
        )
    above = there[-1]
    gone, shown = values[changes[0]], values[changes[0] + 1]
    if not above:
        gone, shown = shown, gone
    for _ in range(60):
        middle = (gone + shown) / 2.0
        if of(middle) >= ALPHA_THRESHOLD:
            shown = middle
        else:
            gone = middle
    return ValueCut(at=shown, above=above)


def _shader_alpha(source: Feed) -> Value:
    node = source.node
    if node is None:
        return 1.0
    if node.type == "BSDF_PRINCIPLED":
        return read_value(source.input("Alpha"))
    if node.type == "BSDF_TRANSPARENT":
        color = source.input("Color")
        if color.node is None:
            return 1.0 - float(np.mean(list(color.socket.default_value)[:3]))
        raise UnreadableAlphaError("a Transparent BSDF with a textured colour")
    if node.type == "MIX_SHADER":
        first, second = _shader_alpha(source.input(1)), _shader_alpha(source.input(2))
        if isinstance(first, float) and first == second:
            return first
        factor = lift_operation(clamp, read_value(source.input(0)))
        return lift_operation(lambda f, a, b: (1.0 - f) * a + f * b, factor, first, second)
    if node.type == "ADD_SHADER":
        first, second = _shader_alpha(source.input(0)), _shader_alpha(source.input(1))
        return lift_operation(lambda a, b: max(0.0, a + b - 1.0), first, second)
    if node.type == "HOLDOUT":
        raise UnreadableAlphaError("a Holdout shader mixed with others")
    return 1.0


def _luminance(rgba: NDArray[np.float32], colorspace: str) -> NDArray[np.float32]:
    """Rec. 709 luminance of an image's pixels as a value socket gets it."""
    if rgba.shape[2] < 3:
        color = np.repeat(rgba[..., :1], 3, axis=2)
    else:
        color = rgba[..., :3]
    if colorspace == "sRGB":
        color = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    return np.asarray(color @ np.array(LUMINANCE_RGB, np.float32), np.float32)
