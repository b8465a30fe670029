"""The number that a mesh's attribute gives as alpha, of every type, domain and output.

Against what Cycles' value sockets get; Blender is stood in for.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from legoworld.scene.blender.alpha_attributes import (
    AttributeSource,
    attribute_source,
    corner_values,
)
from legoworld.scene.blender.alpha_images import _after, _rotation
from legoworld.scene.blender.alpha_values import _ramp
from legoworld.scene.blender.joints import _property_text
from legoworld.scene.blender.materials import _luminance
from legoworld.scene.blender.meshes import Triangles
from legoworld.scene.blender.shader_links import UnreadableAlphaError
from legoworld.scene.blender.strands import _radii

#: Two triangles of a square that is one face: the corners are vertices 3, 2, 1, 0.
CORNERS = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
SQUARE = Triangles(vertices=3 - CORNERS, corners=CORNERS)
RGBA = [0.5, 0.25, 1.0, 0.75]
LUMINANCE = 0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722
PROPERTIES = {"FLOAT2": "vector", "FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color",
              "BYTE_COLOR": "color"}  # fmt: skip


class Data(list):
    def __init__(self, name: str, values: Any) -> None:
        super().__init__(values)
        self.name = name

    def foreach_get(self, name: str, out: Any) -> None:
        assert name == self.name
        out[:] = np.array(self, out.dtype).ravel()


def mesh(kind: str, values: Any, domain: str = "POINT", groups: Any = ()) -> Any:
    attribute = SimpleNamespace(
        data_type=kind, domain=domain, data=Data(PROPERTIES.get(kind, "value"), values)
    )
    return SimpleNamespace(
        attributes={"a": attribute},
        color_attributes=SimpleNamespace(default_color_name="a"),
        polygons=Data("loop_total", [4]),
        vertices=[
            SimpleNamespace(groups=[SimpleNamespace(group=g, weight=w) for g, w in of])
            for of in groups
        ],
    )


SHOWN: Any = SimpleNamespace(vertex_groups={"g": SimpleNamespace(index=1)})


def source(channel: Any = "fac", name: str = "a", node: Any = "attribute") -> AttributeSource:
    return AttributeSource(node=node, name=name, channel=channel)


def values(of: Any, asked: AttributeSource) -> list[list[float]]:
    return corner_values(of, SHOWN, asked, SQUARE).tolist()


@pytest.mark.parametrize(
    ("kind", "stored", "by_channel"),
    [
        ("FLOAT", [0.25], {"fac": 0.25, "luminance": 0.25, "mean": 0.25, "alpha": 1.0}),
        ("INT", [3], {"fac": 3.0, "alpha": 1.0}),
        ("INT8", [-3], {"fac": -3.0}),
        ("BOOLEAN", [True], {"fac": 1.0}),
        ("FLOAT2", [[0.5, 0.25]], {"fac": 0.5, "mean": 0.25, "luminance": 0.2126 * 0.5 + 0.1788}),
        ("FLOAT_VECTOR", [RGBA[:3]], {"fac": 1.75 / 3, "luminance": LUMINANCE, "alpha": 1.0}),
        ("FLOAT_COLOR", [RGBA], {"fac": 1.75 / 3, "luminance": LUMINANCE, "alpha": 0.75}),
        ("BYTE_COLOR", [RGBA], {"luminance": LUMINANCE, "alpha": 0.75}),
        ("QUATERNION", [RGBA], {"mean": 1.75 / 3, "alpha": 0.75}),
    ],
)
def test_every_type_by_every_output(kind, stored, by_channel):
    for channel, expected in by_channel.items():
        found = np.array(values(mesh(kind, stored * 4), source(channel)))
        assert found == pytest.approx(expected), channel


@pytest.mark.parametrize(
    ("domain", "stored", "expected"),
    [
        ("POINT", [0.0, 1.0, 2.0, 3.0], [[3, 2, 1], [3, 1, 0]]),
        ("CORNER", [0.0, 1.0, 2.0, 3.0], [[0, 1, 2], [0, 2, 3]]),
        ("FACE", [7.0], [[7, 7, 7], [7, 7, 7]]),
    ],
)
def test_every_domain(domain, stored, expected):
    found = np.array(values(mesh("FLOAT", stored, domain), source()))
    assert found == pytest.approx(np.array(expected))
    with pytest.raises(UnreadableAlphaError, match="of every edge"):
        values(mesh("FLOAT", stored, "EDGE"), source())


def test_what_is_not_there_is_a_vertex_group_or_nothing():
    plain = mesh("FLOAT", [], groups=[[], [(0, 9.0), (1, 0.5)], [(1, 0.25)], [(2, 9.0)]])
    assert values(plain, source(name="none")) == [[0.0] * 3] * 2
    assert values(plain, source("alpha", "none")) == [[1.0] * 3] * 2
    assert values(plain, source(name="")) == [[0.0] * 3] * 2
    assert values(plain, source(name="g")) == [[0.0, 0.25, 0.5], [0.0, 0.5, 0.0]]
    for channel in ("alpha", "luminance"):
        missing = source(channel, "none", "color attribute")
        assert values(plain, missing) == [[0.0] * 3] * 2
    colors = mesh("FLOAT_COLOR", [RGBA] * 4)
    assert values(colors, source("alpha", "", "color attribute")) == [[0.75] * 3] * 2
    vectors = mesh("FLOAT_VECTOR", [RGBA[:3]] * 4)
    found = values(vectors, source("luminance", node="color attribute"))
    assert np.array(found) == pytest.approx(LUMINANCE)


@pytest.mark.parametrize(
    ("kind", "stored", "node", "said"),
    [
        ("STRING", ["x"], "attribute", "an attribute of type string"),
        ("FLOAT4X4", [0.0], "attribute", "an attribute of type float4x4"),
        ("FLOAT2", [[0.5, 0.25]], "color attribute", "that is not a colour"),
        ("FLOAT", [np.nan], "attribute", "NaN or infinite"),
        ("FLOAT_COLOR", [[0, 0, 0, np.inf]], "attribute", "NaN or infinite"),
    ],
)
def test_what_cannot_be_read(kind, stored, node, said):
    with pytest.raises(UnreadableAlphaError, match=said):
        values(mesh(kind, stored * 4), source(node=node))


def feed(output: str, **node: Any) -> Any:
    return SimpleNamespace(node=SimpleNamespace(**node), output=SimpleNamespace(name=output))


def test_what_a_node_asks_for():
    own = {"type": "VERTEX_COLOR", "layer_name": "c"}
    assert attribute_source(feed("Alpha", **own)) == source("alpha", "c", "color attribute")
    assert attribute_source(feed("Color", **own)) == source("luminance", "c", "color attribute")
    node = {"type": "ATTRIBUTE", "attribute_name": "a", "attribute_type": "GEOMETRY"}
    for output, channel in (("Fac", "fac"), ("Vector", "mean"), ("Color", "luminance")):
        assert attribute_source(feed(output, **node)) == source(channel)
    with pytest.raises(UnreadableAlphaError, match="attribute of the view layer"):
        attribute_source(feed("Fac", **{**node, "attribute_type": "VIEW_LAYER"}))


def test_names_that_cycles_gives_to_its_own_attributes_are_no_mesh_s():
    """What Cycles' Attribute::standard_name and its Blender exporter name."""
    names = """N uv generated generated_transform tangent tangent_sign vertex_color undeformed
        undeformed_N undisplaced undisplaced_N motion_P motion_N particle curve_intercept
        curve_length curve_random point_random ptex_face_id ptex_uv density color flame heat
        temperature velocity velocity_x velocity_y velocity_z pointiness random_per_island
        shadow_transparency position material_index"""
    for kind, of in (("ATTRIBUTE", "attribute_name"), ("VERTEX_COLOR", "layer_name")):
        for name in names.split():
            node = {"type": kind, "attribute_type": "GEOMETRY", of: name}
            with pytest.raises(UnreadableAlphaError, match=f"reserved name '{name}'"):
                attribute_source(feed("Color", **node))


@pytest.mark.parametrize("colorspace", ["sRGB", "Non-Color"])
def test_the_luminance_of_an_image_is_of_linear_light(colorspace):
    picture = np.array([[[0.5, 0.04, 1.0, 0.3]]], np.float32)
    light = [((0.5 + 0.055) / 1.055) ** 2.4, 0.04 / 12.92, 1.0] if colorspace == "sRGB" else (
        [0.5, 0.04, 1.0])  # fmt: skip
    expected = np.dot(light, (0.2126, 0.7152, 0.0722))
    assert _luminance(picture, colorspace) == pytest.approx(expected, rel=1e-6)
    gray = _luminance(picture[..., :2], colorspace)
    assert gray == pytest.approx(light[0], rel=1e-6)


@pytest.mark.parametrize("name", ["Fac", "Factor"])
@pytest.mark.parametrize(
    ("output", "interpolation", "at", "expected"),
    [
        ("Alpha", "LINEAR", 0.5, 0.5), ("Alpha", "CONSTANT", 0.5, 0.2),
        ("Alpha", "LINEAR", 0.25, 0.2), ("Alpha", "LINEAR", 0.1, 0.2),
        ("Alpha", "LINEAR", 0.75, 0.8), ("Alpha", "CONSTANT", 0.75, 0.8),
        ("Color", "LINEAR", 0.5, (LUMINANCE + 1.0) / 2),
    ],
)  # fmt: skip
def test_a_color_ramp_between_its_stops(output, interpolation, at, expected, name, monkeypatch):
    """Blender 5.2 calls the input Factor, which was Fac."""
    monkeypatch.setattr("legoworld.scene.blender.alpha_values.read_value", lambda found: found)
    stops = [SimpleNamespace(position=0.25, color=(*RGBA[:3], 0.2)),
             SimpleNamespace(position=0.75, color=(1, 1, 1, 0.8))]  # fmt: skip
    ramp = SimpleNamespace(color_mode="RGB", interpolation=interpolation, elements=stops)
    asked = feed(output, color_ramp=ramp, inputs=[name])
    asked.input = {name: at}.__getitem__
    assert _ramp(asked) == pytest.approx(expected)
    ramp.interpolation = "EASE"
    with pytest.raises(UnreadableAlphaError, match="neither linear nor steps"):
        _ramp(asked)


def test_custom_properties_as_text():
    group = SimpleNamespace(to_dict=lambda: {"b": 1, "a": SimpleNamespace})
    assert _property_text(group) == '{"a": "' + str(SimpleNamespace) + '", "b": 1}'
    assert _property_text(SimpleNamespace(to_list=lambda: [1, 2.5])) == "[1, 2.5]"
    assert (_property_text("hinge"), _property_text(3)) == ("hinge", "3")


def test_a_mapping_follows_another():
    """A texture's place after two mappings is that of the second at the first's."""
    random = np.random.default_rng(6)
    matrix = np.eye(4)
    matrix[:3, :] = random.normal(size=(3, 4))
    inner = tuple(random.normal(size=6).tolist())
    a, b, c, d, e, f = _after(inner, matrix)
    u, v = 0.3, -0.7
    first = inner[0] * u + inner[1] * v + inner[2], inner[3] * u + inner[4] * v + inner[5]
    expected = matrix @ (*first, 0.0, 1.0)
    assert (a * u + b * v + c, d * u + e * v + f) == pytest.approx(expected[:2])


def test_angles_turn_about_x_then_y_then_z():
    right = np.pi / 2
    assert _rotation((right, 0.0, 0.0)) @ (0, 1, 0) == pytest.approx((0, 0, 1))
    assert _rotation((0.0, right, 0.0)) @ (0, 0, 1) == pytest.approx((1, 0, 0))
    assert _rotation((0.0, 0.0, right)) @ (1, 0, 0) == pytest.approx((0, 1, 0))
    assert _rotation((right, right, 0.0)) @ (0, 1, 0) == pytest.approx((1, 0, 0))
    assert _rotation((right, 0.0, right)) @ (0, 1, 0) == pytest.approx((0, 0, 1))


@pytest.mark.parametrize(
    ("shape", "power"), [(0.0, 1.0), (-0.5, 0.5), (0.5, 2.0), (0.75, 4.0), (-1.0, 0.0)]
)
def test_a_strand_is_thinner_towards_its_tip_by_its_shape(shape, power):
    """Cycles' shaperadius: negative shapes are thick for long, positive ones soon thin."""
    settings = SimpleNamespace(shape=shape, radius_scale=0.2, root_radius=1.0, tip_radius=0.5,
                               use_close_tip=False)  # fmt: skip
    points = np.zeros((2, 3, 3))
    points[0, :, 2] = 0.0, 1.0, 4.0  # a fourth of its way, then its end
    found = _radii(settings, points)
    left = np.array([1.0, 0.75, 0.0]) ** power
    assert found[0] == pytest.approx(0.05 + 0.05 * left)
    assert found[1] == pytest.approx([0.1] * 3), "a strand without a length"
    settings.use_close_tip = True
    assert _radii(settings, points)[:, -1].tolist() == [0.0, 0.0]
