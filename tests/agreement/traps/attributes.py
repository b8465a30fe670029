"""Transparency by what a mesh carries: attributes of corners, points and faces, and its sides."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from agreement.traps.materials import cards, leaf_image, small_picture, textured
from agreement.traps.stage import Expect, camera, material, solid, wall
from numpy.typing import NDArray
from scene.gltf.documents import Document

#: A node tree to the socket of a value.
Read = Callable[[Any], Any]


def _close_up() -> None:
    camera((0, -8, 1.2), (0, 0, 1.2), lens=27)


def _by_attribute(name: str, output: str = "Alpha", kind: str = "GEOMETRY") -> Read:
    def read(tree: Any) -> Any:
        node = tree.nodes.new("ShaderNodeAttribute")
        node.attribute_name, node.attribute_type = name, kind
        return node.outputs[output]

    return read


def _by_color_attribute(name: str, output: str = "Alpha") -> Read:
    def read(tree: Any) -> Any:
        node = tree.nodes.new("ShaderNodeVertexColor")
        node.layer_name = name
        return node.outputs[output]

    return read


def _by_geometry(output: str) -> Read:
    return lambda tree: tree.nodes.new("ShaderNodeNewGeometry").outputs[output]


def _maths(operation: str, *values: Read | float) -> Read:
    def read(tree: Any) -> Any:
        node = tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, float):
                socket.default_value = value
            else:
                tree.links.new(value(tree), socket)
        return node.outputs[0]

    return read


def _image(image: Any, **settings: Any) -> Read:
    return lambda tree: textured(tree, image, **settings).outputs["Alpha"]


def _alpha(name: str, read: Read) -> Any:
    def build(tree: Any) -> Any:
        shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
        tree.links.new(read(tree), shader.inputs["Alpha"])
        return shader.outputs[0]

    return material(name, build)


def _mixed(name: str, factor: Read, alpha: Read | None = None) -> Any:
    """Transparent where the factor is 0."""

    def build(tree: Any) -> Any:
        mix, shader = (
            tree.nodes.new("ShaderNodeMixShader"),
            tree.nodes.new("ShaderNodeBsdfPrincipled"),
        )
        tree.links.new(factor(tree), mix.inputs[0])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
        if alpha is not None:
            tree.links.new(alpha(tree), shader.inputs["Alpha"])
        tree.links.new(shader.outputs[0], mix.inputs[2])
        return mix.outputs[0]

    return material(name, build)


def _places(mesh: Any, domain: str) -> NDArray[np.float64]:
    """(N, 2) places of a domain's elements within a card's 0..1."""
    points = np.array([v.co[:2] for v in mesh.vertices])
    of_element = {
        "POINT": lambda: points,
        "CORNER": lambda: points[[loop.vertex_index for loop in mesh.loops]],
        "FACE": lambda: np.array([points[list(p.vertices)].mean(0) for p in mesh.polygons]),
        "EDGE": lambda: np.array([points[list(e.vertices)].mean(0) for e in mesh.edges]),
    }[domain]
    return np.asarray(of_element() / (2 * np.abs(points).max(0)) + 0.5)


def _paint(name: str, kind: str, domain: str, attribute: str = "paint") -> None:
    """Colours that change over the card of that name; alpha runs diagonally."""
    mesh = bpy.data.objects[name].data
    layer = mesh.attributes.new(attribute, kind, domain)
    u, v = _places(mesh, domain).T
    rgba = np.stack([1.2 * u, 0.9 * v, 0.4 + 0 * u, (0.6 * u + 0.4 * v) ** 1.3], 1)
    if kind == "BYTE_COLOR":
        layer.data.foreach_set("color_srgb", np.clip(rgba, 0, 1).astype(np.float32).ravel())
    elif kind == "FLOAT_COLOR":
        layer.data.foreach_set("color", rgba.astype(np.float32).ravel())
    elif kind in ("FLOAT_VECTOR", "FLOAT2"):
        width = 3 if kind == "FLOAT_VECTOR" else 2
        layer.data.foreach_set("vector", rgba[:, :width].astype(np.float32).ravel())
    else:
        value = {
            "FLOAT": rgba[:, 3].astype(np.float32),
            "BOOLEAN": u > v,
            "INT": np.rint(2 * u * v).astype(np.int32),
        }[kind]
        layer.data.foreach_set("value", value)


def _stand(materials: list[Any]) -> None:
    """A row of cards, each a grid of three faces a side."""
    wall()
    cards(materials, "grid", x_subdivisions=3, y_subdivisions=3)
    _close_up()


def alpha_color_attributes() -> Expect:
    """The alpha of colours by corner, point and face, in bytes and floats, and of no colour."""
    kinds = [(k, d) for k in ("BYTE_COLOR", "FLOAT_COLOR") for d in ("POINT", "CORNER", "FACE")]
    made = [_alpha(f"{k} {d}", _by_color_attribute("paint")) for k, d in kinds]
    default = _alpha("default", _by_color_attribute(""))
    plain = _alpha("plain", _by_color_attribute("paint"))
    missing = _alpha("missing", _by_color_attribute("nowhere"))
    _stand([*made, default, plain, missing])
    for kind, domain in kinds:
        _paint(f"{kind} {domain}", kind, domain)
    _paint("default", "BYTE_COLOR", "CORNER", "first")
    _paint("plain", "FLOAT_VECTOR", "POINT")
    return Expect(seen=("BYTE_COLOR CORNER", "default", "plain"), unseen=("missing",))


def alpha_attribute_outputs() -> Expect:
    """Fac, Color, Vector and Alpha of the Attribute node, for types with and without alpha."""
    made = [
        (kind, output, domain)
        for kind, domain in (
            ("BYTE_COLOR", "CORNER"),
            ("FLOAT_VECTOR", "POINT"),
            ("FLOAT", "CORNER"),
        )
        for output in ("Fac", "Color", "Vector", "Alpha")
    ]
    _stand([_alpha(f"{k} {o}", _by_attribute("paint", o)) for k, o, _ in made])
    for kind, output, domain in made:
        _paint(f"{kind} {output}", kind, domain)
    return Expect(seen=("BYTE_COLOR Alpha", "FLOAT_VECTOR Alpha", "FLOAT Fac", "FLOAT Alpha"))


def alpha_attribute_kinds() -> Expect:
    """Numbers, flags, UV maps and vertex groups by name, and names that nothing has."""
    made = {
        "bool": ("BOOLEAN", "FACE", "Fac"),
        "int": ("INT", "POINT", "Fac"),
        "pair": ("FLOAT2", "CORNER", "Fac"),
        "float": ("FLOAT", "FACE", "Fac"),
    }
    _stand(
        [
            *(
                _alpha(name, _by_attribute("paint", output))
                for name, (_, _, output) in made.items()
            ),
            _alpha("uv map", _by_attribute("UVMap", "Fac")),
            _alpha("group", _by_attribute("group", "Fac")),
            _alpha("no fac", _by_attribute("nowhere", "Fac")),
            _alpha("no alpha", _by_attribute("nowhere", "Alpha")),
        ]
    )
    for name, (kind, domain, _) in made.items():
        _paint(name, kind, domain)
    card = bpy.data.objects["group"]
    group = card.vertex_groups.new(name="group")
    for index, (u, v) in enumerate(_places(card.data, "POINT")):
        if u > 0.1:
            group.add([index], float(0.8 * u + 0.4 * v), "REPLACE")
    return Expect(seen=("uv map", "group", "no alpha", "bool", "int"), unseen=("no fac",))


def alpha_attribute_maths() -> Expect:
    """A colour's alpha inverted, compared, scaled, and times or against an image's alpha."""
    leaf = leaf_image(outside=0.1)
    paint = _by_color_attribute("paint")
    inverted = _maths("SUBTRACT", 1.0, paint)
    image = _image(leaf)
    below = _maths("LESS_THAN", _maths("MULTIPLY", image, paint), 0.3)
    made = [
        _alpha("inverted", inverted),
        _alpha("steps", _maths("GREATER_THAN", paint, 0.35)),
        _alpha("lower", _maths("MULTIPLY_ADD", paint, 3.0, -1.1)),
        _mixed("mixed", paint),
        _alpha("times leaf", _maths("MULTIPLY", paint, image)),
        _alpha("mask", _maths("SUBTRACT", 1.0, below)),
        _mixed("mixed leaf", paint, image),
        _alpha("without leaf", _maths("MULTIPLY", paint, _maths("SUBTRACT", 1.3, image))),
        _alpha("inverted leaf", _maths("MULTIPLY", inverted, _maths("MULTIPLY", image, 1.1))),
    ]
    _stand(made)
    for one in made:
        _paint(one.name, "FLOAT_COLOR", "CORNER")
    return Expect(seen=("inverted", "steps", "times leaf", "mask", "mixed leaf", "without leaf"))


def alpha_one_value() -> Expect:
    """One alpha all over a mesh, alone and times an image."""
    leaf = leaf_image(outside=0.3)
    values = (0.3, 0.5, 0.502, 0.7)
    paint = _by_color_attribute("paint")
    _stand(
        [_alpha(f"plain {v}", paint) for v in values]
        + [_alpha(f"leaf {v}", _maths("MULTIPLY", paint, _image(leaf))) for v in values]
    )
    for kind in ("plain", "leaf"):
        for value in values:
            mesh = bpy.data.objects[f"{kind} {value}"].data
            layer = mesh.attributes.new("paint", "FLOAT_COLOR", "CORNER")
            rgba = np.tile(np.float32([1, 1, 1, value]), len(layer.data))
            layer.data.foreach_set("color", rgba)
    return Expect(
        seen=("plain 0.5", "plain 0.502", "plain 0.7", "leaf 0.7"), unseen=("plain 0.3", "leaf 0.3")
    )


def alpha_sides() -> Expect:
    """Surfaces seen from one side only, or cut otherwise on the other; mirrored and turned."""
    small_picture()
    wall()
    leaf = leaf_image()
    back = _by_geometry("Backfacing")
    front = _maths("SUBTRACT", 1.0, back)
    only_front, only_back = _alpha("only front", front), _alpha("only back", back)
    leafy = _alpha("leaf at the back", _maths("MAXIMUM", front, _image(leaf)))
    faint = _alpha("painted front", _maths("MULTIPLY", front, _by_color_attribute("paint")))
    made = {
        "front": (only_front, (1, 1, 1), 90),
        "back": (only_back, (1, 1, 1), 90),
        "turned front": (only_front, (1, 1, 1), -90),
        "turned back": (only_back, (1, 1, 1), -90),
        "mirrored": (only_front, (-1, 1, 1), 90),
        "mirrored back": (only_back, (-1, 1, 1), 90),
        "leaf": (leafy, (1, 1, 1), -90),
        "painted": (faint, (1, 1, 1), 90),
    }
    for i, (name, (one, scale, turn)) in enumerate(made.items()):
        at = (1.15 * (i - 3.5), 0, 2.0)
        solid("plane", name, at, scale=scale, turn=(turn, 0, 0), size=1.0, material=one)
    _paint("painted", "FLOAT_COLOR", "CORNER")
    ball = solid("uv_sphere", "half ball", (-2, 0, 0), turn=(0, 0, 20), material=only_back)
    ball.scale = (0.8, -0.9, 1)
    solid("uv_sphere", "ball", (0, 0, 0), material=only_front)
    solid("torus", "ring", (2.4, 0, 0), turn=(60, 0, 0), material=leafy)
    _close_up()
    return Expect(
        seen=("front", "turned back", "mirrored", "leaf", "half ball", "ball", "ring", "painted"),
        unseen=("back", "turned front", "mirrored back"),
    )


def alpha_unread_attributes() -> Expect:
    """What stays opaque, with a warning: of edges, of an object, of Cycles' own, of geometry."""
    made = [
        _alpha("of edges", _by_attribute("paint")),
        _alpha("of the object", _by_attribute("paint", "Fac", "OBJECT")),
        _alpha("of cycles", _by_attribute("generated", "Fac")),
        _alpha("no colour", _by_color_attribute("paint", "Color")),
        _alpha("pointiness", _by_geometry("Pointiness")),
        _alpha("islands", _by_geometry("Random Per Island")),
    ]
    _stand(made)
    _paint("of edges", "FLOAT_COLOR", "EDGE")
    _paint("no colour", "FLOAT", "CORNER")
    return Expect(seen=("Wall",), limited=[one.name for one in made])


def alpha_imported_gltf() -> Expect:
    """Vertex colours with alpha as the glTF importer wires them: BLEND, MASK, with a texture."""
    small_picture()
    made = Document(camera=False)
    texels = np.full((8, 8), 255)
    texels[2:5, 1:6], texels[6:, :] = 90, 170
    texture = made.texture(texels)
    blend, mask = {"alphaMode": "BLEND"}, {"alphaMode": "MASK", "alphaCutoff": 0.3}
    textured_color = {"baseColorTexture": {"index": texture}, "baseColorFactor": [1, 1, 1, 0.9]}
    kinds = {
        "blend": blend,
        "mask": mask,
        "opaque": {"alphaMode": "OPAQUE"},
        "blend leaf": blend | {"pbrMetallicRoughness": textured_color},
        "mask leaf": mask | {"pbrMetallicRoughness": textured_color},
    }
    for i, (name, fields) in enumerate(kinds.items()):
        made.textured_quad(fields | {"name": name}, [(0, 1), (1, 1), (1, 0), (0, 0)],
                           x=1.3 * (i - 2.5), y=0.2, side=1.2, name=name)  # fmt: skip
        attributes = made.json["meshes"][-1]["primitives"][0]["attributes"]
        colors = [(1, 1, 1, a) for a in (0.1, 0.8, 1.0, 0.35)]
        attributes["COLOR_0"] = made.accessor(colors)
    path = Path.cwd() / "made.glb"
    path.write_bytes(made.glb())
    bpy.ops.import_scene.gltf(filepath=str(path))
    wall()
    _close_up()
    return Expect(seen=tuple(kinds))


TRAPS = (
    alpha_color_attributes,
    alpha_attribute_outputs,
    alpha_attribute_kinds,
    alpha_attribute_maths,
    alpha_one_value,
    alpha_sides,
    alpha_unread_attributes,
    alpha_imported_gltf,
)
