"""Alpha as a function of an image: where it reaches a half, and the picture that says so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from legoworld.scene.blender.alpha_attributes import AttributeSource
from legoworld.scene.blender.alpha_images import IDENTITY, ImageSource
from legoworld.scene.blender.alpha_values import Curve, ProductSource, SidedValue, lift_operation
from legoworld.scene.blender.materials import ImageAlpha, SidedAlpha, alpha_rule, bake_alpha
from legoworld.scene.blender.shader_links import UnreadableAlphaError

LEAF = ImageSource(
    image="leaf",
    library="",
    channel="alpha",
    uv_map=None,
    uv_transform=IDENTITY,
    wrap="repeat",
    interpolation="linear",
)
BYTES = (np.arange(256, dtype=np.float32) / 255.0).reshape(16, 16)

FUNCTIONS = {
    "as it is": lambda v: v,
    "inverted": lambda v: 1.0 - v,
    "doubled": lambda v: 2.0 * v,
    "nearly all": lambda v: float(v > 0.0),
    "only the full": lambda v: float(v >= 1.0),
    "a mask": lambda v: 1.0 - float(v < 0.25),
    "under a third": lambda v: float(v < 1.0 / 3.0),
    "rounded": lambda v: math.floor(v + 0.5),
    "squared": lambda v: v * v,
}


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
def test_the_baked_picture_cuts_every_byte_value_where_alpha_does(function):
    rule = alpha_rule(Curve(source=LEAF, of=function))
    assert isinstance(rule, ImageAlpha)
    shown = bake_alpha(BYTES, rule) >= 128  # what the kernel takes for 0.5
    expected = np.array([function(float(v)) >= 0.5 for v in BYTES.ravel()]).reshape(16, 16)
    assert np.array_equal(shown, expected)


@pytest.mark.parametrize("cut", [0.1, 0.5, 0.8])
def test_the_baked_picture_keeps_the_cut_between_texels(cut):
    """Between two texels, linear interpolation reaches a half where the image reaches the cut."""
    rule = alpha_rule(Curve(source=LEAF, of=lambda v: float(v >= cut)))
    low, high = np.float32(cut - 0.07), np.float32(cut + 0.04)
    a, b = bake_alpha(np.array([[low, high]], np.float32), rule).ravel() / 255.0
    assert (0.5 - a) / (b - a) == pytest.approx(0.07 / 0.11, abs=0.06)


@pytest.mark.parametrize(
    ("function", "rule"),
    [
        (lambda v: 0.49 * v, "gone"),
        (lambda v: 0.5 + v, "there"),
        (lambda v: float(v < 0.0), "gone"),
        (lambda v: float(v <= 1.0), "there"),
    ],
)
def test_alpha_that_never_crosses_a_half_needs_no_picture(function, rule):
    assert alpha_rule(Curve(source=LEAF, of=function)) == rule


@pytest.mark.parametrize(
    ("alpha", "rule"), [(0.0, "gone"), (0.499, "gone"), (0.5, "there"), (1.0, "there")]
)
def test_constant_alpha(alpha, rule):
    assert alpha_rule(alpha) == rule


def test_a_band_of_alpha_is_not_readable():
    with pytest.raises(UnreadableAlphaError, match="rising or falling"):
        alpha_rule(Curve(source=LEAF, of=lambda v: float(0.3 < v < 0.6)))


def test_an_inverted_picture_clipped_at_its_border_is_not_readable():
    """Outside the picture alpha would be 1, where a clipped picture has nothing."""
    clipped = replace(LEAF, wrap="clip")
    with pytest.raises(UnreadableAlphaError, match="clipped"):
        alpha_rule(Curve(source=clipped, of=lambda v: 1.0 - v))
    assert isinstance(alpha_rule(Curve(source=clipped, of=lambda v: v)), ImageAlpha)


def test_two_lookups_of_one_image_combine_and_of_two_images_do_not():
    leaf = Curve(source=LEAF, of=lambda v: v)
    product = lift_operation(lambda a, b: a * b, leaf, leaf)
    assert isinstance(product, Curve)
    assert product.of(0.5) == 0.25
    other = Curve(source=replace(LEAF, image="bark"), of=lambda v: v)
    with pytest.raises(UnreadableAlphaError, match="two images"):
        lift_operation(lambda a, b: a * b, leaf, other)


PAINT = AttributeSource(node="color attribute", name="paint", channel="alpha")
LEAF_CURVE, PAINT_CURVE = Curve(source=LEAF, of=float), Curve(source=PAINT, of=float)


@pytest.mark.parametrize(
    ("operation", "everywhere"),
    [
        (lambda i, v: i * v, True),
        (lambda i, v: (1.0 - i) * v, True),
        (lambda i, v: (1.3 - i) * (0.2 - v), True),
        (lambda i, v: 0.1 + 2.0 * i * v, True),
        (lambda i, v: i * min(1.0, max(0.0, v)), False),
    ],
)
def test_an_image_times_an_attribute_is_one_source(operation, everywhere):
    made = lift_operation(operation, LEAF_CURVE, PAINT_CURVE)
    assert isinstance(made, Curve)
    assert isinstance(made.source, ProductSource)
    assert made.source.everywhere == everywhere
    for i, v in np.random.default_rng(0).uniform(0, 1, (20, 2)).tolist():
        assert made.of(made.source.at(i, v)) == pytest.approx(operation(i, v))
    swapped = lift_operation(lambda v, i: operation(i, v), PAINT_CURVE, LEAF_CURVE)
    assert isinstance(swapped, Curve)
    assert swapped.source == made.source


@pytest.mark.parametrize(
    ("operation", "others"),
    [
        (max, (LEAF_CURVE, PAINT_CURVE)),
        (lambda a, b: a * b, (PAINT_CURVE, Curve(source=replace(PAINT, name="b"), of=float))),
        (
            lambda a, b: a * b,
            (LEAF_CURVE, lift_operation(lambda a, b: a * b, LEAF_CURVE, PAINT_CURVE)),
        ),
    ],
)
def test_two_sources_that_are_no_product_are_not_readable(operation, others):
    with pytest.raises(UnreadableAlphaError):
        lift_operation(operation, *others)


def test_a_value_of_two_sides_stays_one_of_two_sides():
    back = SidedValue(front=0.0, back=1.0)
    leafy = lift_operation(max, lift_operation(lambda b: 1.0 - b, back), LEAF_CURVE)
    rule = alpha_rule(leafy)
    assert isinstance(rule, SidedAlpha)
    assert rule.front == "there"
    assert rule.back == alpha_rule(LEAF_CURVE)
    assert alpha_rule(lift_operation(lambda b: 0.6 + 0.1 * b, back)) == "there"
