"""Image nodes as a source of alpha: image, channel and texture coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.blender.objects import identity
from legoworld.scene.blender.shader_links import Feed, UnreadableAlphaError
from legoworld.scene.snapshot import Interpolation, Wrap

if TYPE_CHECKING:
    import bpy

Affine2 = tuple[float, float, float, float, float, float]
"""u' = a*u + b*v + c, v' = d*u + e*v + f, as (a, b, c, d, e, f)."""

IDENTITY: Final[Affine2] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class ImageSource:
    """One channel of an image, looked up through a UV map.

    channel: "alpha", or the "luminance" of the colour; "premultiplied" is the luminance of the
    colour times alpha. uv_map: None for the map a render uses by default.
    """

    image: str
    library: str
    channel: Literal["alpha", "luminance", "premultiplied"]
    uv_map: str | None
    uv_transform: Affine2
    wrap: Wrap
    interpolation: Interpolation


def image_source(source: Feed) -> ImageSource:
    """The UV lookup of an image node. UnreadableAlphaError for any other projection or source."""
    node = source.node
    image = node.image
    if image is None or image.source not in ("FILE", "GENERATED"):
        raise UnreadableAlphaError("alpha comes from an image that is not a single picture")
    if node.projection != "FLAT":
        raise UnreadableAlphaError(f"alpha comes from a {node.projection.lower()} projection")
    mapping = node.texture_mapping
    if tuple(mapping.translation) + tuple(mapping.rotation) + tuple(mapping.scale) != (
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0
    ):  # fmt: skip
        raise UnreadableAlphaError("alpha comes from an image node with its own mapping")
    uv_map, transform = _coordinates(source.input("Vector"))
    name, library = identity(image)
    return ImageSource(
        image=name,
        library=library,
        channel=_channel(node, image, source.output),
        uv_map=uv_map,
        uv_transform=transform,
        wrap=node.extension.lower(),
        interpolation="closest" if node.interpolation == "Closest" else "linear",
    )


def _channel(
    node: bpy.types.Node, image: bpy.types.Image, output: bpy.types.NodeSocket
) -> Literal["alpha", "luminance", "premultiplied"]:
    """Cycles multiplies colour by alpha unless the node's Alpha output is in use, too."""
    if output.name == "Alpha":
        return "alpha"
    apart = image.colorspace_settings.is_data or image.alpha_mode in ("CHANNEL_PACKED", "NONE")
    return "luminance" if apart or node.outputs["Alpha"].is_linked else "premultiplied"


def _coordinates(source: Feed) -> tuple[str | None, Affine2]:
    node = source.node
    if node is None:
        return None, IDENTITY
    if node.type == "UVMAP" and not node.from_instancer:
        return node.uv_map or None, IDENTITY
    if node.type == "TEX_COORD" and source.output.name == "UV" and not node.from_instancer:
        return None, IDENTITY
    if node.type == "MAPPING" and source.input("Vector").node is not None:
        uv_map, inner = _coordinates(source.input("Vector"))
        return uv_map, _after(inner, _mapping_matrix(source))
    raise UnreadableAlphaError(f"alpha texture coordinates come from a {node.bl_label} node")


def _mapping_matrix(source: Feed) -> NDArray[np.float64]:
    """The 4 x 4 matrix of a Mapping node whose inputs are constant."""
    vectors = {}
    for name in ("Location", "Rotation", "Scale"):
        if name not in source.node.inputs or not source.node.inputs[name].enabled:
            vectors[name] = (0.0, 0.0, 0.0)
            continue
        part = source.input(name)
        if part.node is not None:
            raise UnreadableAlphaError("alpha texture coordinates come from a varying Mapping node")
        vectors[name] = tuple(part.socket.default_value)
    kind = source.node.vector_type
    if kind not in ("POINT", "TEXTURE") or 0.0 in vectors["Scale"]:
        raise UnreadableAlphaError(f"alpha texture coordinates come from a {kind.lower()} Mapping")
    matrix = np.eye(4)
    matrix[:3, :3] = _rotation(vectors["Rotation"]) * vectors["Scale"]
    matrix[:3, 3] = vectors["Location"]
    return matrix if kind == "POINT" else np.linalg.inv(matrix)


def _rotation(xyz: tuple[float, ...]) -> NDArray[np.float64]:
    """The (3, 3) rotation about x, then y, then z by these angles in radians."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(xyz), np.sin(xyz)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, np.float64)


def _after(inner: Affine2, matrix: NDArray[np.float64]) -> Affine2:
    """First `inner`, then a 4 x 4 matrix on (u, v, 0)."""
    a, b, c, d, e, f = inner
    rows = []
    for r in range(2):
        x, y, w = float(matrix[r, 0]), float(matrix[r, 1]), float(matrix[r, 3])
        rows.append((x * a + y * d, x * b + y * e, x * c + y * f + w))
    return (*rows[0], *rows[1])
