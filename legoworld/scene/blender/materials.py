"""Which surfaces a material's alpha removes: the declared rule, read from the shader nodes.

A constant alpha below `ALPHA_THRESHOLD` removes the surface; an image's alpha removes it sample by
sample; glass and other transmission is a surface; a material with only a volume is not one. What
the rule cannot read is opaque, with a warning that names the material.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class ImageAlpha:
    """Alpha read from an image through a UV map."""

    image: str
    library: str | None
    channel: Literal["alpha", "color"]
    inverted: bool
    uv_map: str | None  # None: the map a render uses by default
    wrap: str
    interpolation: str


Alpha = float | ImageAlpha


class UnreadableAlphaError(Exception):
    """The shader graph is outside the rule."""


def material_alpha(material: Any) -> tuple[Alpha, str | None]:
    """A material's alpha and, where the rule could not read it, a warning."""
    if material is None or material.node_tree is None:
        return 1.0, None
    output = material.node_tree.get_output_node("CYCLES")
    if output is None:
        return 1.0, None
    surface, volume = output.inputs["Surface"], output.inputs["Volume"]
    if not surface.is_linked:
        return (0.0 if volume.is_linked else 1.0), None
    try:
        return _shader_alpha(surface), None
    except UnreadableAlphaError as error:
        return 1.0, f"material {material.name!r}: {error}; its surface is taken as opaque"


def image_alpha(image: Any, rule: ImageAlpha) -> NDArray[np.uint8] | None:
    """(H, W) uint8 alpha, top row first; None when the image has no pixels (a missing file)."""
    width, height = image.size
    if not image.has_data and image.source == "FILE":
        image.update()
        width, height = image.size
    if width == 0 or height == 0:
        return None
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    rgba = pixels.reshape(height, width, image.channels)[::-1]
    if rule.channel == "alpha":
        has_alpha = image.channels == 4 and image.alpha_mode != "NONE"
        alpha = rgba[..., 3] if has_alpha else np.ones((height, width), np.float32)
    else:
        alpha = _luminance(rgba, image.colorspace_settings.name)
    if rule.inverted:
        alpha = 1.0 - alpha
    return np.rint(np.clip(alpha, 0.0, 1.0) * 255.0).astype(np.uint8)


def _shader_alpha(socket: Any) -> Alpha:
    node = _source(socket)
    if node is None:
        return 1.0
    if node.type == "BSDF_PRINCIPLED":
        return _value_alpha(node.inputs["Alpha"])
    if node.type == "BSDF_TRANSPARENT":
        color = node.inputs["Color"]
        if color.is_linked:
            raise UnreadableAlphaError("a Transparent BSDF with a textured colour")
        return 1.0 - float(np.mean(list(color.default_value)[:3]))
    if node.type == "MIX_SHADER":
        return _mixed(node)
    if node.type == "ADD_SHADER":
        parts = [_shader_alpha(s) for s in node.inputs if s.is_linked]
        if any(isinstance(p, ImageAlpha) for p in parts):
            raise UnreadableAlphaError("an Add Shader over an alpha texture")
        return max(0.0, 1.0 - sum(1.0 - p for p in parts if isinstance(p, float)))
    if node.type == "GROUP" and _may_be_transparent(node.node_tree):
        raise UnreadableAlphaError(f"transparency inside the node group {node.node_tree.name!r}")
    return 1.0


def _mixed(node: Any) -> Alpha:
    factor, first, second = node.inputs[0], node.inputs[1], node.inputs[2]
    a, b = _shader_alpha(first), _shader_alpha(second)
    if isinstance(a, float) and isinstance(b, float):
        if a == b:
            return a
        f = _value_alpha(factor)
        if isinstance(f, float):
            return (1.0 - f) * a + f * b
        if (a, b) == (0.0, 1.0):
            return f
        if (a, b) == (1.0, 0.0):
            return ImageAlpha(**{**f.__dict__, "inverted": not f.inverted})
    raise UnreadableAlphaError("a Mix Shader of two textured transparencies")


def _value_alpha(socket: Any) -> Alpha:
    node = _source(socket)
    if node is None:
        return float(socket.default_value)
    if node.type == "VALUE":
        return float(node.outputs[0].default_value)
    if node.type != "TEX_IMAGE":
        raise UnreadableAlphaError(f"alpha comes from a {node.bl_label} node")
    if node.image is None or node.image.source not in ("FILE", "GENERATED"):
        raise UnreadableAlphaError("alpha comes from an image that is not a single picture")
    if node.projection != "FLAT":
        raise UnreadableAlphaError(f"alpha comes from a {node.projection.lower()} projection")
    library = node.image.library
    return ImageAlpha(
        image=node.image.name,
        library=library.filepath if library else None,
        channel="alpha" if _output_name(socket) == "Alpha" else "color",
        inverted=False,
        uv_map=_uv_map(node),
        wrap=node.extension.lower(),
        interpolation="closest" if node.interpolation == "Closest" else "linear",
    )


def _uv_map(texture: Any) -> str | None:
    node = _source(texture.inputs["Vector"])
    if node is None:
        return None
    if node.type == "UVMAP" and not node.from_instancer:
        return node.uv_map or None
    if node.type == "TEX_COORD" and _output_name(texture.inputs["Vector"]) == "UV":
        return None
    raise UnreadableAlphaError(f"alpha texture coordinates come from a {node.bl_label} node")


def _link(socket: Any) -> Any:
    """The link that feeds a socket, reroutes followed; None where nothing does."""
    while socket.is_linked:
        link = socket.links[0]
        if link.is_muted or link.from_node.mute:
            raise UnreadableAlphaError("a muted node decides its alpha")
        if link.from_node.type != "REROUTE":
            return link
        socket = link.from_node.inputs[0]
    return None


def _source(socket: Any) -> Any:
    link = _link(socket)
    return link.from_node if link else None


def _output_name(socket: Any) -> str:
    link = _link(socket)
    return link.from_socket.name if link else ""


def _may_be_transparent(tree: Any) -> bool:
    for node in tree.nodes if tree else ():
        if node.type == "BSDF_TRANSPARENT":
            return True
        if node.type == "BSDF_PRINCIPLED":
            alpha = node.inputs["Alpha"]
            if alpha.is_linked or alpha.default_value < 1.0:
                return True
        if node.type == "GROUP" and _may_be_transparent(node.node_tree):
            return True
    return False


def _luminance(rgba: NDArray[np.float32], colorspace: str) -> NDArray[np.float32]:
    """Rec. 709 luminance of an image's pixels as a value socket gets it."""
    if rgba.shape[2] < 3:
        color = np.repeat(rgba[..., :1], 3, axis=2)
    else:
        color = rgba[..., :3]
    if colorspace == "sRGB":
        color = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    weights = np.array([0.2126, 0.7152, 0.0722], np.float32)
    return np.asarray(color @ weights, np.float32)
