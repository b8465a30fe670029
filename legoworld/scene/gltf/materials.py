"""Which surfaces a glTF material's alpha removes: the rule of `scene.blender.materials`.

alphaMode OPAQUE: the surface is there, whatever its alpha. BLEND: it is there where alpha >= 0.5.
MASK: where alpha >= alphaCutoff. alpha = base colour factor x base colour texture x vertex colour
(glTF 2.0 specification, 3.9.4). doubleSided is not used: every surface has two sides here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from legoworld.conventions import ALPHA_THRESHOLD
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.snapshot import Interpolation, Wrap

_WRAPS: Final[dict[int, Wrap]] = {33071: "extend", 33648: "mirror", 10497: "repeat"}
_REPEAT: Final = 10497
_NEAREST: Final = 9728
_LINEAR: Final = 9729

#: Where a texture's picture is when it is not a PNG or JPEG, by what OpenCV can decode.
_WEBP: Final = "EXT_texture_webp"


@dataclass(frozen=True, kw_only=True)
class TextureAlpha:
    """A surface is there where the picture's alpha >= cutoff (0 < cutoff <= 1).

    uv_set: n of TEXCOORD_n. uv_from_uv: (a, b, c, d, e, f), u' = a u + b v + c, v' = d u + e v + f
    in glTF's texture coordinates (v downwards).
    """

    image: int  # index of the document's images, -1 for one that cannot be decoded
    cutoff: float
    uv_set: int
    uv_from_uv: tuple[float, float, float, float, float, float]
    wrap_s: Wrap
    wrap_t: Wrap
    interpolation: Interpolation


Alpha = Literal["opaque", "gone"] | TextureAlpha


@dataclass(frozen=True, kw_only=True)
class VertexAlpha:
    """A surface is there where gain x vertex alpha x the picture's alpha >= `ALPHA_THRESHOLD`.

    texture: its own cutoff is `ALPHA_THRESHOLD`, so that its picture stays as it is.
    """

    gain: float
    texture: TextureAlpha | None


def material_alpha(document: Fields, material: Fields, vertex_alpha: float) -> Alpha:
    """A material's alpha rule on a surface with constant vertex alpha."""
    threshold = _threshold(material)
    factor, texture = _base_color(material)
    factor *= vertex_alpha
    if threshold <= 0:
        return "opaque"
    if factor < threshold:  # no picture's alpha is above 1
        return "gone"
    if texture is None:
        return "opaque"
    return _texture_alpha(document, texture, threshold / factor)


def varying_alpha(document: Fields, material: Fields) -> Literal["opaque", "gone"] | VertexAlpha:
    """A material's alpha rule on a surface with varying vertex alpha."""
    threshold = _threshold(material)
    factor, texture = _base_color(material)
    if threshold <= 0:
        return "opaque"
    if factor <= 0:
        return "gone"
    return VertexAlpha(
        gain=factor * ALPHA_THRESHOLD / threshold,
        texture=None if texture is None else _texture_alpha(document, texture, ALPHA_THRESHOLD),
    )


def _threshold(material: Fields) -> float:
    """The lowest alpha at which a surface is visible; 0: always visible."""
    mode = material.text("alphaMode", "OPAQUE")
    if mode not in ("OPAQUE", "BLEND", "MASK"):
        raise material.wrong("alphaMode", "OPAQUE, BLEND or MASK")
    if mode == "OPAQUE":
        return 0.0
    return ALPHA_THRESHOLD if mode == "BLEND" else material.number("alphaCutoff", 0.5)


def _base_color(material: Fields) -> tuple[float, Fields | None]:
    """The alpha of the base colour factor, and the base colour texture."""
    glossy = material.extension("KHR_materials_pbrSpecularGlossiness")
    holder = material.child("pbrMetallicRoughness") if glossy is None else glossy
    names = ("baseColorFactor", "baseColorTexture")
    if glossy is not None:
        names = ("diffuseFactor", "diffuseTexture")
    factor = holder.numbers(names[0], 4)
    return (factor[3] if factor else 1.0), holder.child(names[1]) if names[1] in holder else None


def _texture_alpha(document: Fields, info: Fields, cutoff: float) -> TextureAlpha:
    textures, samplers = document.children("textures"), document.children("samplers")
    if "index" not in info:
        raise info.wrong("index", "an index")
    texture = textures[info.index("index", len(textures))]
    number = texture.index("sampler", len(samplers))
    sampler = samplers[number] if number >= 0 else Fields({}, f"{texture.place}.sampler")
    uv_set = info.integer("texCoord", 0)
    transform = info.extension("KHR_texture_transform") or Fields({}, info.place)
    return TextureAlpha(
        image=_image(document, texture),
        cutoff=cutoff,
        uv_set=transform.integer("texCoord", uv_set),
        uv_from_uv=_uv_transform(transform),
        wrap_s=_wrap(sampler, "wrapS"),
        wrap_t=_wrap(sampler, "wrapT"),
        interpolation="closest" if sampler.integer("magFilter", _LINEAR) == _NEAREST else "linear",
    )


def _image(document: Fields, texture: Fields) -> int:
    images = document.children("images")
    webp = texture.extension(_WEBP)
    return (texture if webp is None else webp).index("source", len(images))


def _wrap(sampler: Fields, name: str) -> Wrap:
    value = sampler.integer(name, _REPEAT)
    if value not in _WRAPS:
        raise sampler.wrong(name, ", ".join(map(str, _WRAPS)))
    return _WRAPS[value]


def _uv_transform(transform: Fields) -> tuple[float, float, float, float, float, float]:
    """KHR_texture_transform: translation x rotation x scale of texture coordinates.

    The rotation turns them counter-clockwise as the picture is looked at, where v points down: the
    extension's text and Blender's importer say so; one version of its GLSL had the sign reversed.
    """
    from math import cos, sin

    x, y = transform.numbers("offset", 2) or (0.0, 0.0)
    sx, sy = transform.numbers("scale", 2) or (1.0, 1.0)
    angle = transform.number("rotation", 0.0)
    c, s = cos(angle), sin(angle)
    return c * sx, s * sy, x, -s * sx, c * sy, y
