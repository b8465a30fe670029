"""Transparency as files really wire it: image formats, instances, node groups, shader tricks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from agreement.traps.materials import cards, cut, leaf_image, small_picture, textured
from agreement.traps.stage import (
    Expect,
    camera,
    instance_of,
    material,
    polygons,
    solid,
    unlinked_collection,
    wall,
)

Build = Callable[[Any], Any]


def _close_up() -> None:
    camera((0, -8, 1.2), (0, 0, 1.2), lens=27)


def alpha_images() -> Expect:
    """A leaf as PNG, oblong, premultiplied, channel-packed, alpha unused, in sRGB, in floats."""
    wall()
    packed = leaf_image()
    packed.filepath_raw, packed.file_format = str(Path.cwd() / "leaf.png"), "PNG"
    packed.save()

    def loaded(name: str, **settings: Any) -> Any:
        image = bpy.data.images.load(packed.filepath_raw, check_existing=False)
        image.name = name
        for key, value in settings.items():
            setattr(image, key, value)
        return image

    oblong = bpy.data.images.new("oblong", 48, 7, alpha=True)
    y, x = np.mgrid[0:7, 0:48]
    pixels = np.ones((7, 48, 4), np.float32)
    pixels[..., 3] = 0.05 + 0.9 * ((x // 5 + y) % 2)
    oblong.pixels.foreach_set(pixels.ravel())
    oblong.pack()
    srgb = leaf_image("srgb leaf", alpha=False, outside=0.1)
    srgb.colorspace_settings.name = "sRGB"
    floats = bpy.data.images.new("floats", 32, 32, alpha=True, float_buffer=True)
    floats.pixels.foreach_set(np.array(packed.pixels, np.float32))
    floats.pack()
    cards(
        [
            cut("file", loaded("file"), 1.5, -0.2),
            cut("premultiplied", loaded("p", alpha_mode="PREMUL"), 1.5, -0.2),
            cut("channel packed", loaded("c", alpha_mode="CHANNEL_PACKED"), 1.5, -0.2),
            cut("alpha unused", loaded("n", alpha_mode="NONE")),
            cut("oblong", oblong, 1.2, -0.1, extension="MIRROR"),
            cut("by srgb", srgb, output="Color"),
            cut("floats", floats, 1.3, 0.1),
        ]
    )
    _close_up()
    return Expect(
        seen=(
            "file",
            "premultiplied",
            "channel packed",
            "alpha unused",
            "oblong",
            "by srgb",
            "floats",
        )
    )


def alpha_interpolations() -> Expect:
    """The two interpolations that are more than linear."""
    wall()
    leaf = leaf_image()
    cards([cut(how, leaf, interpolation=how) for how in ("Cubic", "Smart", "Linear")])
    _close_up()
    return Expect(seen=("Cubic", "Smart", "Linear"))


def alpha_instances() -> Expect:
    """A leaf card placed by a collection, by particles, on vertices and by geometry nodes."""
    small_picture()
    wall()
    leaf = cut("leaf", leaf_image())
    twig = unlinked_collection("twig")
    solid("plane", "card", (0, 0, 0.6), turn=(90, 0, 0), size=1.2, material=leaf, collection=twig)
    for i in range(3):
        instance_of(twig, f"twig {i}", (0.9 * (i - 1), -0.2 * i, 2.2), scale=(1 - 0.2 * i, 1, 1))
    loose = solid("plane", "loose card", (0, 0, -30), size=1.0, material=leaf)
    ground = solid("plane", "ground", (-2.5, 0, 0), size=2.5)
    ground.modifiers.new("hair", "PARTICLE_SYSTEM")
    settings = ground.particle_systems[0].settings
    settings.type, settings.count, settings.render_type = "HAIR", 30, "OBJECT"
    settings.instance_object, settings.particle_size, settings.use_rotations = loose, 0.4, True
    settings.rotation_factor_random, settings.hair_length = 0.6, 1
    host = solid("ico_sphere", "host", (2.4, 0, 1), subdivisions=1)
    child = solid("plane", "vertex card", size=0.7, turn=(90, 0, 0), material=leaf)
    child.parent, host.instance_type = host, "VERTS"
    _close_up()
    return Expect(seen=("card", "loose card", "vertex card"))


def alpha_deformed_uv() -> Expect:
    """Texture coordinates through subdivision, mirroring, an array and geometry nodes."""
    small_picture()
    wall()
    leaf = cut("leaf", leaf_image())
    smooth = solid("cube", "subdivided", (-3, 0, 1.2), turn=(0, 0, 30), material=leaf)
    smooth.modifiers.new("s", "SUBSURF").render_levels = 2
    many = solid("plane", "arrayed", (-1, 0, 1.2), turn=(90, 0, 0), size=0.8, material=leaf)
    array = many.modifiers.new("a", "ARRAY")
    array.count, array.offset_u, array.offset_v = 3, 0.3, 0.2
    half = solid("plane", "mirrored", (2, 0, 1.8), turn=(90, 0, 0), size=1.2, material=leaf)
    for vertex in half.data.vertices:
        vertex.co.x += 0.6
    mirror = half.modifiers.new("m", "MIRROR")
    mirror.use_mirror_u, mirror.offset_v = True, 0.15
    named = cut("named", leaf_image("named leaf"), uv_map="made by nodes")
    _generated_card("generated", named, (3.2, 0, 1.2))
    _close_up()
    return Expect(seen=("subdivided", "arrayed", "mirrored", "generated"))


def _generated_card(name: str, leaf: Any, at: tuple[float, float, float]) -> None:
    """A grid made by nodes, its UV stored as a named attribute and its material set by a node."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    grid, store = (
        tree.nodes.new("GeometryNodeMeshGrid"),
        tree.nodes.new("GeometryNodeStoreNamedAttribute"),
    )
    store.data_type, store.domain = "FLOAT2", "CORNER"
    store.inputs["Name"].default_value = "made by nodes"
    dress, result = tree.nodes.new("GeometryNodeSetMaterial"), tree.nodes.new("NodeGroupOutput")
    dress.inputs["Material"].default_value = leaf
    tree.links.new(grid.outputs["Mesh"], store.inputs["Geometry"])
    tree.links.new(grid.outputs["UV Map"], store.inputs["Value"])
    tree.links.new(store.outputs[0], dress.inputs["Geometry"])
    tree.links.new(dress.outputs[0], result.inputs[0])
    card = polygons(name, [], [], at)
    card.rotation_euler = (1.4, 0, 0.3)
    card.modifiers.new("nodes", "NODES").node_group = tree


def alpha_graphs() -> Expect:
    """Alpha through reroutes, frames, two outputs, an Add Shader and a value node."""
    wall()
    leaf = leaf_image()

    def rerouted(tree: Any) -> Any:
        shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
        bend = tree.nodes.new("NodeReroute")
        tree.links.new(textured(tree, leaf).outputs["Alpha"], bend.inputs[0])
        tree.links.new(bend.outputs[0], shader.inputs["Alpha"])
        return shader.outputs[0]

    def added(tree: Any) -> Any:
        add = tree.nodes.new("ShaderNodeAddShader")
        clear = tree.nodes.new("ShaderNodeBsdfTransparent")
        clear.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1)
        tree.links.new(clear.outputs[0], add.inputs[0])
        tree.links.new(tree.nodes.new("ShaderNodeEmission").outputs[0], add.inputs[1])
        return add.outputs[0]

    def valued(tree: Any) -> Any:
        shader, value = (
            tree.nodes.new("ShaderNodeBsdfPrincipled"),
            tree.nodes.new("ShaderNodeValue"),
        )
        value.outputs[0].default_value = 0.2
        tree.links.new(value.outputs[0], shader.inputs["Alpha"])
        return shader.outputs[0]

    def two_outputs(tree: Any) -> Any:
        other = tree.nodes.new("ShaderNodeOutputMaterial")
        other.target = "CYCLES"
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], other.inputs[0])
        return tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0]

    def nested_mix(tree: Any) -> Any:
        clear, solid_part = (
            tree.nodes.new("ShaderNodeBsdfTransparent"),
            tree.nodes.new("ShaderNodeBsdfDiffuse"),
        )
        inner, outer = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeMixShader")
        inner.inputs[0].default_value, outer.inputs[0].default_value = 0.5, 0.5
        tree.links.new(clear.outputs[0], inner.inputs[1])
        tree.links.new(solid_part.outputs[0], inner.inputs[2])
        tree.links.new(inner.outputs[0], outer.inputs[1])
        tree.links.new(clear.outputs[0], outer.inputs[2])
        return outer.outputs[0]

    made: tuple[tuple[str, Build], ...] = (
        ("rerouted", rerouted),
        ("added", added),
        ("valued", valued),
        ("two outputs", two_outputs),
        ("nested mix", nested_mix),
    )
    cards([material(name, build) for name, build in made])
    _close_up()
    return Expect(seen=("rerouted",), unseen=("valued", "two outputs", "nested mix"))


def alpha_tricks() -> Expect:
    """Surfaces that depend on the kind of ray, or on the side that is seen."""
    wall()

    def trick(kind: str, socket: str) -> Build:
        def build(tree: Any) -> Any:
            mix, source = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new(kind)
            tree.links.new(source.outputs[socket], mix.inputs[0])
            tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[1])
            tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[2])
            return mix.outputs[0]

        return build

    made: tuple[tuple[str, Build], ...] = (
        ("shadow ray", trick("ShaderNodeLightPath", "Is Shadow Ray")),
        ("camera ray", trick("ShaderNodeLightPath", "Is Camera Ray")),
        ("backfacing", trick("ShaderNodeNewGeometry", "Backfacing")),
    )
    cards([material(name, build) for name, build in made])
    _close_up()
    return Expect(seen=("shadow ray", "backfacing"), unseen=("camera ray",))


def alpha_maths() -> Expect:
    """A leaf inside a node group, and with a mapping before or maths after its texture."""
    wall()
    leaf = leaf_image()

    def grouped(tree: Any) -> Any:
        inside = bpy.data.node_groups.new("inside", "ShaderNodeTree")
        inside.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
        shader, result = (
            inside.nodes.new("ShaderNodeBsdfPrincipled"),
            inside.nodes.new("NodeGroupOutput"),
        )
        inside.links.new(textured(inside, leaf).outputs["Alpha"], shader.inputs["Alpha"])
        inside.links.new(shader.outputs[0], result.inputs[0])
        group = tree.nodes.new("ShaderNodeGroup")
        group.node_tree = inside
        return group.outputs[0]

    def wired(kind: str) -> Build:
        return lambda tree: _between(tree, leaf, kind)

    made: tuple[tuple[str, Build], ...] = (
        ("grouped", grouped),
        ("mapped", wired("ShaderNodeMapping")),
        ("threshold", wired("ShaderNodeMath")),
        ("ramp", wired("ShaderNodeValToRGB")),
    )
    cards([material(name, build) for name, build in made])
    _close_up()
    return Expect(seen=tuple(name for name, _ in made))


def _between(tree: Any, leaf: Any, kind: str) -> Any:
    """A leaf's alpha with one more node before or after the texture."""
    shader, node = tree.nodes.new("ShaderNodeBsdfPrincipled"), textured(tree, leaf)
    extra, last = tree.nodes.new(kind), node.outputs["Alpha"]
    if kind == "ShaderNodeMapping":
        where = tree.nodes.new("ShaderNodeTexCoord")
        extra.inputs["Scale"].default_value = (2, 3, 1)
        tree.links.new(where.outputs["UV"], extra.inputs["Vector"])
        tree.links.new(extra.outputs[0], node.inputs["Vector"])
    else:
        if kind == "ShaderNodeMath":
            extra.operation = "LESS_THAN"
            extra.inputs[1].default_value = 0.2
        else:
            extra.color_ramp.elements[0].position = 0.25
        tree.links.new(last, extra.inputs[0])
        last = extra.outputs[0]
    tree.links.new(last, shader.inputs["Alpha"])
    return shader.outputs[0]


TRAPS = (
    alpha_images,
    alpha_interpolations,
    alpha_instances,
    alpha_deformed_uv,
    alpha_graphs,
    alpha_maths,
    alpha_tricks,
)
