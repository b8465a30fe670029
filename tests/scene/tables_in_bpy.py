"""Run with a Python that has bpy: what each modifier, kind of data, object type and attribute does.

Prints one JSON object; `test_tables_in_bpy.py` says what belongs in it.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import bpy
import numpy as np
from cases.stage import collection, fresh, link, polygons, square

from legoworld.errors import MissingLibraryError
from legoworld.scene.blender import open_file, programs
from legoworld.scene.blender.alpha_attributes import AttributeSource
from legoworld.scene.blender.alpha_images import ImageSource
from legoworld.scene.blender.alpha_values import ProductSource
from legoworld.scene.blender.cut_meshes import MeshCutter
from legoworld.scene.blender.materials import AttributeAlpha
from legoworld.scene.blender.meshes import Triangles
from legoworld.scene.blender.settings import Settings, mesh_sha256
from legoworld.scene.blender.shader_links import UnreadableAlphaError
from legoworld.scene.blender.viewport import _is_still


def main() -> int:
    """See the module's docstring."""
    told = {
        "moving": {
            "plain": not _is_still(bpy.context.scene),
            "modifiers": _moving_modifiers(),
            "data": [name for name, make in _DATA.items() if _moves(lambda m=make: _animate(m))],
            "others": [name for name, change in _MOVING.items() if _moves(change)],
        },
        "missing": _missing(),
        "built": _built(),
        "attributes": {kind: _attribute(kind) for kind in _ATTRIBUTES},
        "products": _products(),
        "changed": [name for name, change in _CHANGES.items() if _is_changed(change)],
    }
    print("\n" + json.dumps(told))
    return 0


def _moves(change: Callable[[], object]) -> bool:
    fresh()
    square("Square")
    change()
    return not _is_still(bpy.context.scene)


def _moving_modifiers() -> list[str]:
    """Modifiers of a mesh with which the viewport keeps its scene."""
    fresh()
    made = square("Square")
    moving = []
    for kind in sorted(bpy.types.Modifier.bl_rna.properties["type"].enum_items.keys()):
        try:
            modifier = made.modifiers.new(kind, kind)
        except (RuntimeError, TypeError):
            continue  # of another type of object
        if modifier is not None:
            if not _is_still(bpy.context.scene):
                moving.append(kind)
            made.modifiers.clear()
    return moving


def _shape_keys() -> Any:
    bpy.data.objects["Square"].shape_key_add(name="Basis")
    return bpy.data.shape_keys[0]


_DATA: dict[str, Callable[[], Any]] = {
    "cameras": lambda: bpy.data.cameras.new("a"),
    "curves": lambda: bpy.data.curves.new("a", "CURVE"),
    "hair_curves": lambda: bpy.data.hair_curves.new("a"),
    "lattices": lambda: bpy.data.lattices.new("a"),
    "lights": lambda: bpy.data.lights.new("a", "POINT"),
    "materials": lambda: bpy.data.materials.new("a"),
    "meshes": lambda: bpy.data.meshes.new("a"),
    "metaballs": lambda: bpy.data.metaballs.new("a"),
    "node_groups": lambda: bpy.data.node_groups.new("a", "ShaderNodeTree"),
    "nodes of a material": lambda: bpy.data.materials.new("a").node_tree,
    "objects": lambda: bpy.data.objects.new("a", None),
    "pointclouds": lambda: bpy.data.pointclouds.new("a"),
    "scenes": lambda: bpy.data.scenes.new("a"),
    "shape_keys": _shape_keys,
    "speakers": lambda: bpy.data.speakers.new("a"),
    "textures": lambda: bpy.data.textures.new("a", "CLOUDS"),
    "worlds": lambda: bpy.data.worlds.new("a"),
}


def _animate(make: Callable[[], Any]) -> None:
    make().animation_data_create()


def _image_of(source: str) -> None:
    bpy.data.images.new("image", 1, 1).source = source


def _node(kind: str) -> None:
    bpy.data.node_groups.new("tree", "GeometryNodeTree").nodes.new(kind)


_MOVING: dict[str, Callable[[], object]] = {
    "a marker": lambda: bpy.context.scene.timeline_markers.new("m", frame=1),
    "a rigid body world": lambda: bpy.ops.rigidbody.world_add(),
    "an action": lambda: bpy.data.actions.new("a"),
    "a sequence of images": lambda: _image_of("SEQUENCE"),
    "a film": lambda: _image_of("MOVIE"),
    "an image": lambda: _image_of("FILE"),
    "a simulation": lambda: _node("GeometryNodeSimulationOutput"),
    "a bake": lambda: _node("GeometryNodeBake"),
    "a cube": lambda: _node("GeometryNodeMeshCube"),
}


def _missing() -> list[str]:
    """Kinds of data without one of which a file is refused."""
    kinds = [p.identifier for p in bpy.types.BlendData.bl_rna.properties if p.type == "COLLECTION"]
    library = SimpleNamespace(filepath="//parts.blend")
    gone = SimpleNamespace(name="a", is_missing=True, library=library)
    refused = []
    for kind in (name for name in kinds if name != "libraries"):
        held: dict[str, Any] = dict.fromkeys(kinds, ()) | {kind: [gone]}
        open_file.bpy = SimpleNamespace(data=SimpleNamespace(**held))
        try:
            open_file._refuse_missing_libraries()
        except MissingLibraryError as error:
            refused += [kind] * ("'a' is not in 'parts.blend'" in str(error.found))
        finally:
            open_file.bpy = bpy
    return refused


def _built() -> dict[str, bool]:
    """Whether a program that adds nothing but an object of a type has built a scene."""
    data = bpy.data
    makes: dict[str, Callable[[], Any]] = {
        "MESH": lambda: data.meshes.new("a"), "CURVE": lambda: data.curves.new("a", "CURVE"),
        "SURFACE": lambda: data.curves.new("a", "SURFACE"), "META": lambda: data.metaballs.new("a"),
        "FONT": lambda: data.curves.new("a", "FONT"), "CURVES": lambda: data.hair_curves.new("a"),
        "POINTCLOUD": lambda: data.pointclouds.new("a"), "VOLUME": lambda: data.volumes.new("a"),
        "EMPTY": lambda: None, "CAMERA": lambda: data.cameras.new("a"),
        "LIGHT": lambda: data.lights.new("a", "SUN"), "SPEAKER": lambda: data.speakers.new("a"),
    }  # fmt: skip
    module: Any = programs
    module.export_scene = lambda _output: []
    module._run = lambda _program, _skipped: build()
    built = {}
    for kind, make in makes.items():
        fresh()

        def build(kind: str = kind, make: Callable[[], Any] = make) -> None:
            made = link(bpy.data.objects.new("a", make()))
            assert made.type == kind, made.type

        with tempfile.TemporaryDirectory() as folder:
            try:
                programs.execute_program(Path(folder) / "p.py", Path(folder), lambda _stage: None)
                built[kind] = True
            except programs.ProgramBuiltNothingError:
                built[kind] = False
    return built


_ATTRIBUTES: dict[str, tuple[str, Any, Any]] = {
    "FLOAT": ("value", 0.5, 0.25), "INT": ("value", 7, 8), "INT8": ("value", 3, -3),
    "BOOLEAN": ("value", True, False), "FLOAT_VECTOR": ("vector", (1, 2, 3), (1, 2, 4)),
    "FLOAT2": ("vector", (1, 2), (1, 3)), "FLOAT_COLOR": ("color", (1, 0, 1, 1), (1, 0, 1, 0)),
    "BYTE_COLOR": ("color", (1, 0, 1, 1), (1, 0, 1, 0)), "STRING": ("value", b"a", b"b"),
    "INT32_2D": ("value", (1, 2), (1, 3)), "INT16_2D": ("value", (1, 2), (1, 3)),
    "QUATERNION": ("value", (1, 0, 0, 0), (0, 0, 0, 1)),
    "FLOAT4X4": ("value", [(0, 0, 0, 0)] * 4, [(0, 0, 0, 0)] * 3 + [(0, 0, 0, 1)]),
}  # fmt: skip


def _attribute(kind: str) -> list[bool]:
    """Whether a mesh's hash is the same for the same values, and for others at its last vertex."""
    fresh()
    made = polygons("Triangle", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    field, first, other = _ATTRIBUTES[kind]
    attribute = made.data.attributes.new("a", kind, "POINT")
    told = []
    for value in (first, first, other):
        setattr(attribute.data[2], field, value)
        told.append(mesh_sha256(made.data))
    return [told[1] == told[0], told[2] == told[0]]


#: An image's value i times an attribute's v: a + b i + c v + d i v, and what more is known.
_PRODUCTS: dict[str, tuple[tuple[float, float, float, float], dict[str, Any]]] = {
    "i v": ((0, 0, 0, 1), {}), "(1 - i) v": ((0, 0, 1, -1), {}), "(i + 1) v": ((0, 0, 1, 1), {}),
    "i v + 0.45": ((0.45, 0, 0, 1), {}), "i v + 0.55": ((0.55, 0, 0, 1), {}),
    "(i - 0.5) v": ((0, 0, -0.5, 1), {}), "i (1 - v)": ((0, 1, 0, -1), {}),
    "i + v": ((0, 1, 1, 0), {}), "1 - i v": ((1, 0, 0, -1), {}),
    "i v of a clipped image": ((0, 0, 0, 1), {"wrap": "clip"}),
    "(i + 1) v of a clipped image": ((0, 0, 1, 1), {"wrap": "clip"}),
    "i v beyond 1": ((0, 0, 0, 1), {"most": 1.5}),
    "i v below 0": ((0, 0, 0, 1), {"least": -0.5}),
    "i v of any v": ((0, 0, 0, 1), {"least": -0.5, "most": 1.5, "everywhere": True}),
    "2 i v of v to 0.2": ((0, 0, 0, 2), {"most": 0.2}),
    "1 + i v": ((1, 0, 0, 1), {}),
}  # fmt: skip


def _products() -> dict[str, Any]:
    """How many of 13 values of i at 300 corners are cut otherwise than by the sum, or why none."""
    return {name: _product(*of, **known) for name, (of, known) in _PRODUCTS.items()}


def _product(
    *of: float,
    wrap: Any = "repeat",
    least: float = 0.0,
    most: float = 1.0,
    everywhere: bool = False,
) -> Any:
    image = ImageSource(
        image="a", library="", channel="alpha", uv_map=None, uv_transform=(1, 0, 0, 0, 1, 0),
        wrap=wrap, interpolation="linear",
    )  # fmt: skip
    attribute = AttributeSource(node="attribute", name="v", channel="fac")
    a, b, c, d = of
    source = ProductSource(
        image=image, attribute=attribute, coefficients=(a, b, c, d), everywhere=everywhere
    )
    cuts: list[Any] = []
    cutter: Any = MeshCutter(
        mesh=cast("Any", SimpleNamespace(uv_layers=(), name="m")),
        evaluated_object=cast("Any", None),
        alphas=cast("Any", SimpleNamespace(cut_number=lambda cut: cuts.append(cut) or 0)),
        warnings=set(), unread=set(),
    )  # fmt: skip
    corners = np.arange(300, dtype=np.int32).reshape(100, 3)
    values = np.random.default_rng(1).uniform(least, most, (100, 3))
    values[0] = least, most, (least + most) / 2
    rule = AttributeAlpha(source=source, of=lambda value: value)
    try:
        pieces = cutter._product(
            Triangles(vertices=corners, corners=corners),
            np.arange(100),
            rule,
            source,
            values,
            "both",
        )
    except UnreadableAlphaError as error:
        return str(error)
    shares = np.linspace(0, 1, 13)[:, None, None]
    wanted = a + b * shares + c * values + d * shares * values >= 0.5
    found = np.zeros_like(wanted)
    for piece in pieces:
        factor = 1.0
        if piece.cut >= 0 and cuts[piece.cut].image is not None:
            factor = shares * cuts[piece.cut].image.gain + cuts[piece.cut].image.offset
            assert -1e-12 <= factor.min() <= factor.max() <= 1 + 1e-12
        alpha = np.ones((len(piece.place), 3)) if piece.alpha is None else piece.alpha
        found[:, piece.place] = factor * alpha >= 0.5
    return [int((wanted != found).sum()), bool(wanted.any()), len(pieces)]


def _is_changed(change: Callable[[dict[str, Any]], object]) -> bool:
    """Whether what is said of a scene's parts differs after a change of one."""
    fresh()
    made = square("Square", collection=collection("Box"))
    made.shape_key_add(name="Basis")
    made.shape_key_add(name="Key")
    tree = bpy.data.materials.new("Nodes").node_tree
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.interface.new_socket("Value", in_out="INPUT", socket_type="NodeSocketFloat")
    action = bpy.data.actions.new("Action")
    armature = bpy.data.armatures.new("Bones")
    rig = link(bpy.data.objects.new("Rig", armature))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    armature.edit_bones.new("Bone").tail = (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    made.animation_data_create().action = action
    made.keyframe_insert("location", index=0, frame=1)
    scene = bpy.context.scene
    parts: dict[str, Any] = {
        "object": made, "mesh": made.data, "keys": made.data.shape_keys, "scene": scene,
        "node": tree.nodes["Principled BSDF"], "bone": armature.bones[0], "armature": armature,
        "pose": rig.pose, "pose bone": rig.pose.bones[0], "animation": made.animation_data,
        "curve": made.animation_data.action.layers[0].strips[0].channelbags[0].fcurves[0],
        "collection": bpy.data.collections["Box"], "layer": bpy.context.view_layer,
        "group": group,
        "held": bpy.context.view_layer.layer_collection.children["Box"],
    }  # fmt: skip
    before = {name: Settings().of(part) for name, part in parts.items()}
    change(parts)
    return before != {name: Settings().of(part) for name, part in parts.items()}


def _set(part: str, name: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda parts: setattr(parts[part], name, value)


_CHANGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "node moved": _set("node", "location", (5, 5)),
    "node widened": _set("node", "width", 300),
    "node named": _set("node", "label", "shiny"),
    "node coloured": _set("node", "color", (1, 0, 0)),
    "node chosen": _set("node", "select", False),
    "node muted": _set("node", "mute", True),
    "what a new node of a group has": lambda parts: setattr(
        parts["group"].interface.items_tree[0], "default_value", 0.5
    ),
    "node in a group": lambda parts: parts["group"].nodes.new("ShaderNodeMath"),
    "mesh with a material": lambda parts: parts["mesh"].materials.append(bpy.data.materials[0]),
    "object moved": _set("object", "location", (1, 2, 3)),
    "object scaled": _set("object", "scale", (1, 2, 3)),
    "object drawn as wire": _set("object", "display_type", "WIRE"),
    "object named in the window": _set("object", "show_name", True),
    "object out of renders": _set("object", "hide_render", True),
    "bone coloured": lambda parts: setattr(parts["bone"].color, "palette", "THEME01"),
    "bone without deforming": _set("bone", "use_deform", False),
    "pose bone coloured": lambda parts: setattr(parts["pose bone"].color, "palette", "THEME01"),
    "pose bone drawn": lambda parts: setattr(parts["pose bone"], "custom_shape", parts["object"]),
    "pose bone moved": _set("pose bone", "location", (1, 2, 3)),
    "path of the pose drawn": lambda parts: setattr(
        parts["pose"].animation_visualization.motion_path, "frame_end", 99
    ),
    "curve coloured": _set("curve", "color", (1, 0, 0)),
    "curve locked": _set("curve", "lock", True),
    "curve smoothed by hand": _set("curve", "auto_smoothing", "NONE"),
    "curve muted": _set("curve", "mute", True),
    "in a collection": lambda parts: parts["collection"].objects.link(bpy.data.objects["Rig"]),
    "collection out of renders": _set("collection", "hide_render", True),
    "eye closed": _set("held", "hide_viewport", True),
    "collection held out": _set("held", "holdout", True),
    "cursor": lambda parts: setattr(parts["scene"].cursor, "location", (1, 2, 3)),
    "tools": lambda parts: setattr(parts["scene"].tool_settings, "use_snap", True),
    "frame": _set("scene", "frame_current", 7),
    "key's value": lambda parts: setattr(parts["keys"].key_blocks["Key"], "value", 0.5),
    "key's point": lambda parts: setattr(parts["keys"].key_blocks["Key"].data[0], "co", (9, 9, 9)),
    "vertex": lambda parts: setattr(parts["mesh"].vertices[0], "co", (9, 9, 9)),
}


if __name__ == "__main__":
    sys.exit(main())
