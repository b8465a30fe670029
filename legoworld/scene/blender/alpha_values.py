"""Value sockets as functions of one image: what the alpha rule can read of a shader's numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.blender.shader_links import Feed, UnreadableAlphaError
from legoworld.scene.snapshot import Interpolation, Wrap

Affine2 = tuple[float, float, float, float, float, float]
"""u' = a*u + b*v + c, v' = d*u + e*v + f, as (a, b, c, d, e, f)."""

#: Rec. 709 weights by which Cycles turns a colour into a value.
LUMINANCE_RGB: Final = (0.2126, 0.7152, 0.0722)

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


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A number that depends on one image value, and how."""

    source: ImageSource
    of: Callable[[float], float]


Value = float | Curve


def lifted(operation: Callable[..., float], *values: Value) -> Value:
    """An operation on numbers, applied to values that depend on at most one image lookup."""
    curves = [value for value in values if isinstance(value, Curve)]
    if not curves:
        return operation(*values)
    source = curves[0].source
    if any(curve.source != source for curve in curves):
        raise UnreadableAlphaError("alpha comes from two images")

    def of(image_value: float) -> float:
        return operation(*(x.of(image_value) if isinstance(x, Curve) else x for x in values))

    return Curve(source=source, of=of)


def read_value(source: Feed) -> Value:
    """A value socket's number. Raises UnreadableAlphaError for what the rule does not cover."""
    if source.is_constant:
        return source.value()
    node = source.node
    if node.type == "LIGHT_PATH":
        return _camera_ray(source.output.name)
    if node.type == "TEX_IMAGE":
        return Curve(source=_image_source(source), of=float)
    if node.type == "MATH" and node.operation in _MATH:
        operation, n_inputs = _MATH[node.operation]
        result = lifted(operation, *(read_value(source.input(i)) for i in range(n_inputs)))
        return lifted(clamped, result) if node.use_clamp else result
    if node.type == "INVERT" and source.input("Color").node is not None:
        factor = read_value(source.input(0))
        return lifted(lambda f, x: x + f * (1.0 - 2.0 * x), factor, read_value(source.input(1)))
    if node.type == "MAP_RANGE" and node.data_type == "FLOAT":
        return _map_range(source)
    if node.type == "VALTORGB":
        return _ramp(source)
    raise UnreadableAlphaError(f"alpha comes from a {_described(node)} node")


def clamped(value: float) -> float:
    """The value, at least 0 and at most 1."""
    return min(1.0, max(0.0, value))


_MATH: Final[dict[str, tuple[Callable[..., float], int]]] = {
    "ADD": (lambda a, b: a + b, 2),
    "SUBTRACT": (lambda a, b: a - b, 2),
    "MULTIPLY": (lambda a, b: a * b, 2),
    "DIVIDE": (lambda a, b: a / b if b else 0.0, 2),
    "MULTIPLY_ADD": (lambda a, b, c: a * b + c, 3),
    "MINIMUM": (min, 2),
    "MAXIMUM": (max, 2),
    "GREATER_THAN": (lambda a, b: float(a > b), 2),
    "LESS_THAN": (lambda a, b: float(a < b), 2),
    "ROUND": (lambda a: float(math.floor(a + 0.5)), 1),
    "CEIL": (lambda a: float(math.ceil(a)), 1),
    "FLOOR": (lambda a: float(math.floor(a)), 1),
}
"""Math nodes by operation, as Cycles computes them, with their number of inputs."""


def _camera_ray(fact: str) -> float:
    """What a Light Path node says of a ray that comes straight from the camera."""
    if fact in ("Ray Length", "Transparent Depth"):
        raise UnreadableAlphaError(f"alpha comes from a Light Path node ({fact.lower()})")
    return 1.0 if fact == "Is Camera Ray" else 0.0


def _map_range(source: Feed) -> Value:
    node = source.node
    if node.interpolation_type != "LINEAR":
        raise UnreadableAlphaError("alpha comes from a Map Range node that is not linear")
    inputs = [read_value(source.input(name)) for name in (
        "Value", "From Min", "From Max", "To Min", "To Max"
    )]  # fmt: skip

    def mapped(x: float, from_0: float, from_1: float, to_0: float, to_1: float) -> float:
        share = (x - from_0) / (from_1 - from_0) if from_1 != from_0 else 0.0
        result = to_0 + share * (to_1 - to_0)
        return min(max(result, min(to_0, to_1)), max(to_0, to_1)) if node.clamp else result

    return lifted(mapped, *inputs)


def _ramp(source: Feed) -> Value:
    """A Color Ramp, evaluated by Blender."""
    ramp = source.node.color_ramp
    if ramp.color_mode != "RGB" or ramp.interpolation not in ("LINEAR", "CONSTANT"):
        raise UnreadableAlphaError("alpha comes from a Color Ramp that is neither linear nor steps")
    stops = [(float(stop.position), tuple(stop.color)) for stop in ramp.elements]
    linear, is_alpha = ramp.interpolation == "LINEAR", source.output.name == "Alpha"

    def value(color: tuple[float, ...]) -> float:
        weights = (0.0, 0.0, 0.0, 1.0) if is_alpha else (*LUMINANCE_RGB, 0.0)
        return sum(c * w for c, w in zip(color, weights, strict=True))

    def at(x: float) -> float:
        before = [stop for stop in stops if stop[0] <= x]
        after = [stop for stop in stops if stop[0] > x]
        if not before or not after or not linear:
            return value(before[-1][1] if before else stops[0][1])
        (x0, first), (x1, second) = before[-1], after[0]
        share: float = (x - x0) / (x1 - x0)
        return (1.0 - share) * value(first) + share * value(second)

    return lifted(at, read_value(source.input("Fac" if "Fac" in source.node.inputs else "Factor")))


def _described(node: Any) -> str:
    if node.type == "MATH":
        return f"Math ({node.operation.lower().replace('_', ' ')})"
    return str(node.bl_label)


def _image_source(source: Feed) -> ImageSource:
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
    return ImageSource(
        image=image.name,
        library=image.library.filepath if image.library else "",
        channel=_channel(node, image, source.output),
        uv_map=uv_map,
        uv_transform=transform,
        wrap=node.extension.lower(),
        interpolation="closest" if node.interpolation == "Closest" else "linear",
    )


def _channel(node: Any, image: Any, output: Any) -> Literal["alpha", "luminance", "premultiplied"]:
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
        return uv_map, _after(inner, _mapping(source))
    raise UnreadableAlphaError(f"alpha texture coordinates come from a {node.bl_label} node")


def _mapping(source: Feed) -> NDArray[np.float64]:
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
