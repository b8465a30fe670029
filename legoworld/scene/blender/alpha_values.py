"""Value sockets as functions of an image or an attribute, as supported by the alpha rule."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from legoworld.scene.blender.alpha_attributes import (
    LUMINANCE_RGB,
    AttributeSource,
    attribute_source,
)
from legoworld.scene.blender.alpha_images import ImageSource, image_source
from legoworld.scene.blender.shader_links import Feed, UnreadableAlphaError

if TYPE_CHECKING:
    import bpy


@dataclass(frozen=True, kw_only=True)
class ProductSource:
    """a + b*i + c*v + d*i*v of an image's value i and an attribute's value v.

    coefficients: (a, b, c, d). everywhere: whether that holds for v outside 0..1, too.
    """

    image: ImageSource
    attribute: AttributeSource
    coefficients: tuple[float, float, float, float]
    everywhere: bool

    def at(self, i: float, v: float) -> float:
        """The value at one image value and one attribute value."""
        a, b, c, d = self.coefficients
        return a + b * i + c * v + d * i * v


Source = ImageSource | AttributeSource | ProductSource


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A number that depends on what one source gives, and how."""

    source: Source
    of: Callable[[float], float]


@dataclass(frozen=True, kw_only=True)
class SidedValue:
    """A value that is another one on the back of a surface."""

    front: float | Curve
    back: float | Curve


Value = float | Curve | SidedValue


def lift_operation(operation: Callable[..., float], *values: Value) -> Value:
    """An operation on numbers, applied to values.

    Raises UnreadableAlphaError where they depend on two sources, unless these are an image and an
    attribute and the result is linear in each of them.
    """
    if any(isinstance(value, SidedValue) for value in values):
        front, back = (
            lift_operation(
                operation, *(getattr(v, side) if isinstance(v, SidedValue) else v for v in values)
            )
            for side in ("front", "back")
        )
        assert not isinstance(front, SidedValue)
        assert not isinstance(back, SidedValue)
        return SidedValue(front=front, back=back)
    sources: list[Source] = []
    for value in values:
        if isinstance(value, Curve) and value.source not in sources:
            sources.append(value.source)
    if not sources:
        return operation(*values)

    def of(*given: float) -> float:
        known = list(zip(sources, given, strict=True))
        return operation(
            *(
                x.of(next(g for s, g in known if s == x.source)) if isinstance(x, Curve) else x
                for x in values
            )
        )

    return Curve(source=sources[0], of=of) if len(sources) == 1 else _product(sources, of)


def _product(sources: list[Source], of: Callable[..., float]) -> Curve:
    images = [s for s in sources if isinstance(s, ImageSource)]
    attributes = [s for s in sources if isinstance(s, AttributeSource)]
    if len(sources) != 2 or not images or not attributes:
        what = "images" if len(images) == len(sources) else "sources"
        raise UnreadableAlphaError(f"alpha comes from two {what}")

    def at(i: float, v: float) -> float:
        return of(*(i if source is images[0] else v for source in sources))

    a = at(0.0, 0.0)
    b, c = at(1.0, 0.0) - a, at(0.0, 1.0) - a
    made = ProductSource(
        image=images[0],
        attribute=attributes[0],
        coefficients=(a, b, c, at(1.0, 1.0) - a - b - c),
        everywhere=False,
    )

    def fits(*attribute_values: float) -> bool:
        grid = [(i, v) for i in (0.0, 0.2, 0.5, 0.9, 1.0) for v in attribute_values]
        return all(math.isclose(at(*g), made.at(*g), abs_tol=1e-9) for g in grid)

    if not fits(0.0, 0.1, 0.4, 0.7, 1.0):
        raise UnreadableAlphaError("alpha is not the product of its image and its attribute")
    return Curve(source=replace(made, everywhere=fits(-3.0, 2.0, 9.0)), of=float)


def read_value(source: Feed) -> Value:
    """A value socket's number. Raises UnreadableAlphaError for what the rule does not cover."""
    if source.is_constant:
        return source.value()
    node = source.node
    if node.type == "LIGHT_PATH":
        return _camera_ray(source.output.name)
    if node.type == "TEX_IMAGE":
        return Curve(source=image_source(source), of=float)
    if node.type in ("ATTRIBUTE", "VERTEX_COLOR"):
        return Curve(source=attribute_source(source), of=float)
    if node.type == "NEW_GEOMETRY" and source.output.name == "Backfacing":
        return SidedValue(front=0.0, back=1.0)
    if node.type == "MATH" and node.operation in _MATH:
        operation, n_inputs = _MATH[node.operation]
        result = lift_operation(operation, *(read_value(source.input(i)) for i in range(n_inputs)))
        return lift_operation(clamp, result) if node.use_clamp else result
    if node.type == "INVERT" and source.input("Color").node is not None:
        factor = read_value(source.input(0))
        return lift_operation(
            lambda f, x: x + f * (1.0 - 2.0 * x), factor, read_value(source.input(1))
        )
    if node.type == "MAP_RANGE" and node.data_type == "FLOAT":
        return _map_range(source)
    if node.type == "VALTORGB":
        return _ramp(source)
    raise UnreadableAlphaError(f"alpha comes from a {_describe_node(node)} node")


def clamp(value: float) -> float:
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
    """The output of a Light Path node for a camera ray."""
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

    def map_range(x: float, from_0: float, from_1: float, to_0: float, to_1: float) -> float:
        share = (x - from_0) / (from_1 - from_0) if from_1 != from_0 else 0.0
        result = to_0 + share * (to_1 - to_0)
        return min(max(result, min(to_0, to_1)), max(to_0, to_1)) if node.clamp else result

    return lift_operation(map_range, *inputs)


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

    return lift_operation(
        at, read_value(source.input("Fac" if "Fac" in source.node.inputs else "Factor"))
    )


def _describe_node(node: bpy.types.Node) -> str:
    if node.type == "MATH":
        return f"Math ({node.operation.lower().replace('_', ' ')})"
    return str(node.bl_label)
