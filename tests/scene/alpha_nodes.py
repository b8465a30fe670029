"""Run with a Python that has bpy: what the alpha rule reads of shader nodes, one case at a time.

Prints one JSON object: by case the value (at several image values where it depends on one), the
rule, or the words that say why it is not read.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

import bpy

from legoworld.scene.blender.alpha_images import ImageSource
from legoworld.scene.blender.alpha_values import Curve, SidedValue, read_value
from legoworld.scene.blender.materials import ImageAlpha, material_rule
from legoworld.scene.blender.shader_links import UnreadableAlphaError, find_feed

Wire = Callable[[Any], Any]  # node tree -> the socket that carries alpha
IMAGE_VALUES = (0.0, 0.25, 0.6, 1.0)
TURNED = (0.3, -0.5, 0.7)  # about x, y and z


def main() -> int:
    """See the module's docstring."""
    values = {name: _value(wire) for name, wire in {**_maths(), **_others()}.items()}
    rules = {name: _rule(build) for name, build in _shaders().items()}
    images = {name: _image(change) for name, change in _lookups().items()}
    print("\n" + json.dumps({"values": values, "rules": rules, "images": images}))
    return 0


def _tree() -> Any:
    material = bpy.data.materials.new("case")
    material.use_nodes = True
    return material.node_tree


def _value(wire: Wire) -> Any:
    tree = _tree()
    socket = tree.nodes["Principled BSDF"].inputs["Alpha"]
    tree.links.new(wire(tree), socket)
    return _told(socket)


def _told(socket: Any) -> Any:
    try:
        read = read_value(find_feed(socket))
    except UnreadableAlphaError as error:
        return str(error)
    if isinstance(read, SidedValue):
        return {"front": read.front, "back": read.back}
    return [read.of(value) for value in IMAGE_VALUES] if isinstance(read, Curve) else read


def _node(tree: Any, kind: str, *inputs: Any, **settings: Any) -> Any:
    """A node; an input is a number, a colour, or a socket to link."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for key, value in settings.items():
        setattr(node, key, value)
    for socket, value in zip(node.inputs, inputs, strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        elif value is not None:
            socket.default_value = value
    return node


def _picture(tree: Any, **settings: Any) -> Any:
    image = bpy.data.images.get("leaf") or bpy.data.images.new("leaf", 2, 2, alpha=True)
    return _node(tree, "TexImage", image=image, **settings)


def _math(operation: str, *inputs: float | str, **settings: Any) -> Wire:
    def wire(tree: Any) -> Any:
        given = [_picture(tree).outputs["Alpha"] if i == "image" else i for i in inputs]
        return _node(tree, "Math", *given, operation=operation, **settings).outputs[0]

    return wire


def _maths() -> dict[str, Wire]:
    return {
        " ".join([operation, *map(str, inputs), *settings]): _math(operation, *inputs, **settings)
        for operation, inputs, settings in (
            ("ADD", (0.25, 0.5), {}),
            ("ADD", (0.75, 0.5), {}),
            ("ADD", (0.75, 0.5), {"use_clamp": True}),
            ("SUBTRACT", (0.25, 0.5), {}),
            ("SUBTRACT", (0.25, 0.5), {"use_clamp": True}),
            ("MULTIPLY", (0.25, 0.5), {}),
            ("DIVIDE", (0.25, 0.5), {}),
            ("DIVIDE", (0.25, 0.0), {}),
            ("MULTIPLY_ADD", (0.25, 0.5, 0.5), {}),
            ("MINIMUM", (0.25, 0.5), {}),
            ("MAXIMUM", (0.25, 0.5), {}),
            ("GREATER_THAN", (0.5, 0.25), {}),
            ("GREATER_THAN", (0.5, 0.5), {}),
            ("LESS_THAN", (0.25, 0.5), {}),
            ("LESS_THAN", (0.5, 0.5), {}),
            ("ROUND", (0.5,), {}),
            ("ROUND", (1.25,), {}),
            ("CEIL", (0.25,), {}),
            ("FLOOR", (1.75,), {}),
            ("POWER", (0.5, 2.0), {}),
            ("SUBTRACT", (1.0, "image"), {}),
            ("MULTIPLY", ("image", 2.0), {"use_clamp": True}),
        )
    }


def _others() -> dict[str, Wire]:
    def light(fact: str) -> Wire:
        return lambda tree: _node(tree, "LightPath").outputs[fact]

    def mapped(value: float, low: float, high: float, **settings: Any) -> Wire:
        return lambda tree: _node(tree, "MapRange", value, 0.0, 0.5, low, high, **settings).outputs[
            0
        ]

    def ramp(at: float, output: str = "Color", mode: str = "RGB", steps: str = "LINEAR") -> Wire:
        def wire(tree: Any) -> Any:
            node = _node(tree, "ValToRGB", at)
            node.color_ramp.color_mode, node.color_ramp.interpolation = mode, steps
            first, last = node.color_ramp.elements
            first.position, first.color = 0.25, (0.0, 0.0, 1.0, 0.5)
            last.position, last.color = 0.75, (0.0, 1.0, 0.0, 1.0)
            return node.outputs[output]

        return wire

    def inverted(tree: Any) -> Any:
        value = _node(tree, "Value")
        value.outputs[0].default_value = 0.75
        return _node(tree, "Invert", 0.25, value.outputs[0]).outputs[0]

    def grouped(tree: Any) -> Any:
        inner = bpy.data.node_groups.new("halved", "ShaderNodeTree")
        inner.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketFloat")
        inner.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketFloat")
        given, result = inner.nodes.new("NodeGroupInput"), inner.nodes.new("NodeGroupOutput")
        half = _node(inner, "Math", given.outputs[0], 0.5, operation="MULTIPLY")
        inner.links.new(half.outputs[0], result.inputs[0])
        group = _node(tree, "Group", node_tree=inner)
        tree.links.new(_picture(tree).outputs["Alpha"], group.inputs[0])
        reroute = tree.nodes.new("NodeReroute")
        tree.links.new(group.outputs[0], reroute.inputs[0])
        return reroute.outputs[0]

    def muted(tree: Any) -> Any:
        return _node(tree, "Math", 0.5, 0.5, mute=True).outputs[0]

    return {
        "camera ray": light("Is Camera Ray"),
        "shadow ray": light("Is Shadow Ray"),
        "ray length": light("Ray Length"),
        "transparent depth": light("Transparent Depth"),
        "mapped": mapped(0.25, 0.5, 1.0),
        "mapped beyond": mapped(1.0, 0.0, 1.0, clamp=False),
        "mapped beyond, held": mapped(1.0, 0.0, 1.0),
        "mapped below, held": mapped(-1.0, 1.0, 0.25),
        "mapped in steps": mapped(0.25, 0.0, 1.0, interpolation_type="STEPPED"),
        "ramp in the middle": ramp(0.5),
        "ramp's alpha": ramp(0.5, "Alpha"),
        "ramp before": ramp(0.0),
        "ramp after": ramp(1.0),
        "ramp in steps": ramp(0.5, steps="CONSTANT"),
        "ramp eased": ramp(0.5, steps="EASE"),
        "ramp of hues": ramp(0.5, mode="HSV"),
        "inverted": inverted,
        "inverted constant": lambda tree: _node(tree, "Invert", 0.25, (1, 1, 1, 1)).outputs[0],
        "back": lambda tree: _node(tree, "NewGeometry").outputs["Backfacing"],
        "position": lambda tree: _node(tree, "NewGeometry").outputs["Position"],
        "grouped": grouped,
        "muted": muted,
    }


def _rule(build: Callable[[Any, Any], None]) -> list[Any]:
    tree = _tree()
    material = next(m for m in bpy.data.materials if m.node_tree == tree)
    output = tree.get_output_node("CYCLES")
    for link in list(output.inputs["Surface"].links):
        tree.links.remove(link)
    build(tree, output)
    rule, warnings = material_rule(material)
    words = [w.split(": ", 1)[-1] if ": " in w else w.split("' ", 1)[-1] for w in warnings]
    bpy.data.materials.remove(material)
    return [[rule.cut, rule.above] if isinstance(rule, ImageAlpha) else str(rule), *words]


def _shaders() -> dict[str, Callable[[Any, Any], None]]:
    def shown(kind: str, *inputs: Any) -> Callable[[Any, Any], None]:
        def build(tree: Any, output: Any) -> None:
            tree.links.new(_node(tree, kind, *inputs).outputs[0], output.inputs["Surface"])

        return build

    def mixed(kind: str, factor: float | None, first: str, second: str) -> Any:
        def build(tree: Any, output: Any) -> None:
            shaders = [_node(tree, name).outputs[0] for name in (first, second)]
            inputs = shaders if factor is None else [factor, *shaders]
            tree.links.new(_node(tree, kind, *inputs).outputs[0], output.inputs["Surface"])

        return build

    def volume(tree: Any, output: Any) -> None:
        tree.links.new(_node(tree, "VolumeAbsorption").outputs[0], output.inputs["Volume"])

    def displaced(method: str) -> Any:
        def build(tree: Any, output: Any) -> None:
            material = next(m for m in bpy.data.materials if m.node_tree == tree)
            material.displacement_method = method
            tree.links.new(_node(tree, "Displacement").outputs[0], output.inputs["Displacement"])

        return build

    def cut(tree: Any, output: Any) -> None:
        shader = _node(tree, "BsdfPrincipled")
        tree.links.new(_math("MULTIPLY", "image", 2.0)(tree), shader.inputs["Alpha"])
        tree.links.new(shader.outputs[0], output.inputs["Surface"])

    clear, dull, hole = "BsdfTransparent", "BsdfDiffuse", "Holdout"
    return {
        "nothing": lambda _tree, _output: None,
        "only a volume": volume,
        "transparent": shown(clear, (1.0, 1.0, 1.0, 1.0)),
        "tinted": shown(clear, (0.9, 0.6, 0.0, 1.0)),
        "rather clear": shown(clear, (0.9, 0.6, 0.3, 1.0)),
        "emission": shown("Emission"),
        "holdout": shown(hole),
        "mixed to the second": mixed("MixShader", 0.5, clear, dull),
        "mixed to the first": mixed("MixShader", 0.25, clear, dull),
        "mixed beyond": mixed("MixShader", 4.0, clear, dull),
        "mixed with a holdout": mixed("MixShader", 0.5, hole, dull),
        "added": mixed("AddShader", None, clear, dull),
        "added twice": mixed("AddShader", None, dull, dull),
        "displaced": displaced("DISPLACEMENT"),
        "bumped": displaced("BUMP"),
        "cut": cut,
    }


def _image(change: Callable[[Any, Any], Any]) -> Any:
    tree = _tree()
    texture = _picture(tree)
    output = change(tree, texture) or "Alpha"
    socket = tree.nodes["Principled BSDF"].inputs["Alpha"]
    tree.links.new(texture.outputs[output], socket)
    try:
        read = read_value(find_feed(socket))
    except UnreadableAlphaError as error:
        return str(error)
    assert isinstance(read, Curve)
    assert isinstance(read.source, ImageSource)
    s = read.source
    return [s.image, s.channel, s.uv_map, [round(x, 6) for x in s.uv_transform], s.wrap,
            s.interpolation]  # fmt: skip


def _lookups() -> dict[str, Callable[[Any, Any], Any]]:
    def setting(**settings: Any) -> Any:
        def change(_tree: Any, texture: Any) -> None:
            for key, value in settings.items():
                setattr(texture, key, value)

        return change

    def color(mode: str, data: bool, both: bool = False) -> Any:
        def change(tree: Any, texture: Any) -> str:
            texture.image = bpy.data.images.new("c", 2, 2, alpha=True, is_data=data)
            texture.image.alpha_mode = mode
            if both:
                unused = _node(tree, "Math")
                tree.links.new(texture.outputs["Alpha"], unused.inputs[0])
            return "Color"

        return change

    def coordinates(kind: str, output: str | int = 0, **settings: Any) -> Any:
        def change(tree: Any, texture: Any) -> None:
            node = _node(tree, kind, **settings)
            tree.links.new(node.outputs[output], texture.inputs["Vector"])

        return change

    def mapping(kind: str, linked: bool = True, scale: float = 2.0, **more: Any) -> Any:
        def change(tree: Any, texture: Any) -> None:
            node = _node(tree, "Mapping", vector_type=kind)
            if linked:
                uv = _node(tree, "UVMap", uv_map="second")
                tree.links.new(uv.outputs[0], node.inputs["Vector"])
            given = {"Location": (0.25, 0.5, 0), "Scale": (scale, 4, 1), **more}
            for name, value in given.items():
                if name in node.inputs:
                    node.inputs[name].default_value = value
            tree.links.new(node.outputs[0], texture.inputs["Vector"])

        return change

    def shifted(_tree: Any, texture: Any) -> None:
        texture.texture_mapping.translation.x = 1.0

    def film(_tree: Any, texture: Any) -> None:
        texture.image = bpy.data.images.new("film", 2, 2)
        texture.image.source = "SEQUENCE"

    return {
        "plain": lambda _tree, _texture: None,
        "clipped": setting(extension="CLIP"),
        "extended": setting(extension="EXTEND"),
        "mirrored": setting(extension="MIRROR"),
        "closest": setting(interpolation="Closest"),
        "cubic": setting(interpolation="Cubic"),
        "box": setting(projection="BOX"),
        "own mapping": shifted,
        "film": film,
        "no image": setting(image=None),
        "color": color("STRAIGHT", data=False),
        "color and alpha": color("STRAIGHT", data=False, both=True),
        "packed color": color("CHANNEL_PACKED", data=False),
        "color alone": color("NONE", data=False),
        "data": color("STRAIGHT", data=True),
        "map": coordinates("UVMap", uv_map="second"),
        "default map": coordinates("UVMap"),
        "instancer's map": coordinates("UVMap", from_instancer=True),
        "uv": coordinates("TexCoord", "UV"),
        "instancer's uv": coordinates("TexCoord", "UV", from_instancer=True),
        "generated": coordinates("TexCoord", "Generated"),
        "mapped": mapping("POINT"),
        "mapped back": mapping("TEXTURE"),
        "mapped and turned": mapping("POINT", Rotation=TURNED),
        "mapped and turned back": mapping("TEXTURE", Rotation=TURNED),
        "mapped vector": mapping("VECTOR"),
        "mapped flat": mapping("POINT", scale=0.0),
        "mapped nothing": mapping("POINT", linked=False),
    }


if __name__ == "__main__":
    sys.exit(main())
