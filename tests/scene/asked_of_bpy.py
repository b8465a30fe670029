"""Run with a Python that has bpy: joints, images, settings and hair of small scenes made here.

Prints one JSON object; `test_asked_of_bpy.py` says what belongs in it.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import mathutils
import numpy as np
from scene.by_hand import CAMERA

from legoworld.scene.blender import thin_meshes
from legoworld.scene.blender.alpha_table import AlphaTable
from legoworld.scene.blender.integrity import _image_users, _nodes, _object_images
from legoworld.scene.blender.joints import joint_facts
from legoworld.scene.blender.settings import CUSTOM, Settings, _plain, mesh_sha256
from legoworld.scene.blender.thin_meshes import ThinMeshes
from legoworld.scene.hair.strands import Strands


def main() -> int:
    """See the module's docstring."""
    told = {"joints": _joints(), "images": _images(), "settings": _settings(), "hair": _hair()}
    print("\n" + json.dumps(told))
    return 0


def _added(name: str, data: Any = None) -> Any:
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    return made


def _joints() -> Any:
    """One joint whose object is infinitely far away in x alone, and one as it should be."""
    body, huge, door, lost = (_added(name) for name in ("Body", "Huge", "Door", "Away"))
    door.parent, lost.parent = body, huge
    huge.scale, door.location, lost.location = (1e30, 1, 1), (1, 2, 3), (1e30, 0, 0)
    door["joint"] = {"type": "revolute", "lower": 0, "axis": [0, 0, 1]}
    lost["joint"] = "x" * 3000
    return joint_facts(bpy.context.scene)


def _images() -> Any:
    """One image in the compositor, one in a group twice, one behind the camera, one in no use."""
    shown, painted, behind, _ = (bpy.data.images.new(f"image {i}", 2, 2) for i in range(4))
    scene = bpy.context.scene
    tree = bpy.data.node_groups.new("compositor", "CompositorNodeTree")
    scene.compositing_node_group = tree
    tree.nodes.new("CompositorNodeImage").image = shown
    group = bpy.data.node_groups.new("group", "ShaderNodeTree")
    group.nodes.new("ShaderNodeTexImage").image = painted
    material = bpy.data.materials.new("painted")
    material.use_nodes = True
    for _twice in range(2):
        material.node_tree.nodes.new("ShaderNodeGroup").node_tree = group
    bpy.data.cameras.new("camera").background_images.new().image = behind
    mesh = bpy.data.meshes.new("mesh")
    mesh.materials.append(None)
    mesh.materials.append(material)
    _added("Painted", mesh)
    return {
        "users": {name: sorted(users) for name, users in _image_users(scene).items()},
        "of objects": _object_images(),
        "nodes": sum(node.bl_idname == "ShaderNodeTexImage" for node in _nodes(material.node_tree)),
    }


def _settings() -> Any:
    holder = _added("Holder")
    values = {"text": "1", "whole": 1, "yes": True, "part": 1.0, "row": [1, 2], "inner": {"a": "b"}}
    for key, value in values.items():
        holder[key] = value
    holder["of"] = bpy.data.objects["Body"]
    settings = Settings().of(holder)
    return {
        "custom": settings[CUSTOM],
        "plain": [_plain(v) for v in (b"\1\xff", {"b", "a"}, 0.5, 2, "s", None, (1.0, True))],
        "meshes": {name: mesh_sha256(_strip(name)) for name in ("", *_STRIPS)},
        "images": {name: _picture(change) for name, change in _PICTURES.items()},
        "files": _pictures_of_a_file(),
        "shapes": [_shaped(height) for height in (0.0, 0.0, 1.0)],
        "add-on": CUSTOM in Settings().of(bpy.context.scene.cycles),
        "links": [_linked(*ends) for ends in ((0, 0), (0, 1), (1, 0))],
    }


_STRIPS = ("render map", "render colour", "faces", "hidden", "chosen")


def _strip(change: str) -> Any:
    """A strip of quads with two UV maps and colours; what `change` names differs."""
    faces = [(0, 1, 2, 3, 4, 5)] if change == "faces" else [(0, 1, 2), (3, 4, 5)]
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (2, 1, 0), (2, 2, 0), (0, 2, 0)]
    mesh = bpy.data.meshes.new("strip")
    mesh.from_pydata(corners, [], faces)
    for name in ("a", "b"):
        mesh.uv_layers.new(name=name)
        mesh.color_attributes.new(name + "c", "FLOAT_COLOR", "POINT")
    mesh.uv_layers[int(change == "render map")].active_render = True
    mesh.color_attributes.render_color_index = int(change == "render colour")
    mesh.polygons[0].hide = change == "hidden"
    mesh.polygons[0].select = change == "chosen"
    return mesh


_PICTURES: dict[str, Any] = {
    "": lambda _image: None,
    "alpha": lambda image: setattr(image, "alpha_mode", "NONE"),
    "colours": lambda image: setattr(image.colorspace_settings, "name", "Non-Color"),
    "pixels": lambda image: image.pixels.__setitem__(0, 0.75),
}


def _picture(change: Any) -> str:
    image = bpy.data.images.new("picture", 2, 2)
    change(image)
    read = _read_of(image)
    bpy.data.images.remove(image)
    return read


def _pictures_of_a_file() -> list[str]:
    """An image as its file is, painted without saving, and after its file's bytes changed."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.bmp"
        pixels = b"BM\x3a\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\1\0\0\0\1\0\0\0\1\0\x18\0"
        pixels = pixels.ljust(54, b"\0") + b"\x10\x20\x30\0"
        file.write_bytes(pixels)
        image = bpy.data.images.load(str(file))
        told = [_read_of(image)]
        image.pixels[0] = 0.75
        told.append(_read_of(image))
        image.reload()
        changed = file.stat().st_mtime_ns
        file.write_bytes(pixels[:-2] + b"\x31\0")
        os.utime(file, ns=(changed, changed))
        told.append(_read_of(image))
        file.unlink()
        told.append(_read_of(image))
    return told


def _read_of(image: Any) -> str:
    """What a material says of itself that shows an image."""
    material = bpy.data.materials.new("own")
    material.use_nodes = True
    material.node_tree.nodes.new("ShaderNodeTexImage").image = image
    read = json.dumps(Settings().of(material)["node_tree"])
    bpy.data.materials.remove(material)
    return read


def _shaped(height: float) -> Any:
    """The settings of a shape key, one of whose points is that high."""
    holder = bpy.data.objects.new("shaped", _strip(""))
    holder.shape_key_add(name="basis")
    holder.data.shape_keys.key_blocks[0].data[1].co.z = height
    read = Settings().of(holder.data.shape_keys.key_blocks[0])
    bpy.data.objects.remove(holder)
    return read


def _linked(output: int, given: int) -> Any:
    tree = bpy.data.node_groups.new("links", "ShaderNodeTree")
    uv, add = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeMath")
    tree.links.new(uv.outputs[output], add.inputs[given])
    return Settings().of(tree)["links"]


def _thin(shape: str = "RIBBONS", subdivisions: int = 2, **changed: Any) -> ThinMeshes:
    given: dict[str, Any] = {
        "camera": CAMERA,
        "camera_object": None,
        "curve_settings": SimpleNamespace(shape=shape, subdivisions=subdivisions),
        "renders_hair": True,
        "meshes": [],
        "alphas": AlphaTable(),
        "warnings": set(),
        **changed,
    }
    return ThinMeshes(**given)


#: Two strands of three keys.
STRANDS = Strands(
    points=np.array([(x, y, 0.1 * y * y) for x in (0.0, 1.0) for y in (0.0, 1.0, 2.0)]),
    radius=np.array([0.1, 0.1, 0.05] * 2),
    start=np.array([0, 3, 6]),
)
THERE, GONE, HOLDOUT = (0,), (1,), (2,)  # rules as `AlphaTable` numbers them


class _Thing:
    """What is asked of an object: its address, its data's, slots of its hair, size of its cloud."""

    def __init__(self, number: int = 1, slots: tuple[int, ...] = (), size: int = 0) -> None:
        self.data = SimpleNamespace(as_pointer=lambda: number)
        self.original, self.name, self.slots, self.size = self, "thing", slots, size

    def as_pointer(self) -> int:
        return 7


def _hair() -> Any:
    module: Any = thin_meshes
    module.hair_systems = lambda thing: thing.slots
    module.particle_hair = lambda _real, slot, _camera: SimpleNamespace(strands=STRANDS, slot=slot)
    module.curve_strands = lambda shown: (STRANDS, shown.data.as_pointer() == 2)
    cloud = np.array([(0.0, 0.0, 0.0), (1.0, 2.0, 3.0), (0.0, 0.0, 4.0)])
    radius = np.array([0.5, 0.25, 1e-6])
    module.cloud_points = lambda thing: (cloud[: thing.size], radius[: thing.size])
    where = mathutils.Matrix(((0, -2, 0, 5), (2, 0, 0, 6), (0, 0, 2, 7), (0, 0, 0, 1)))
    flat = mathutils.Matrix(((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 0), (0, 0, 0, 1)))

    def numbers(
        kind: str, rules: Any, *, held_out: bool = False, at: Any = where, **made: Any
    ) -> Any:
        thing = made.pop("thing", _Thing(slots=(0,)))
        return list(getattr(_thin(**made), kind)(thing, at, rules, held_out=held_out))

    def triangles(thing: Any = None, **made: Any) -> int:
        thin = _thin(**made)
        thin.curves(thing or _Thing(), where, THERE, held_out=False)
        return len(thin.meshes[0].triangles)

    def scattered(count: int, rules: Any, *, held_out: bool = False, at: Any = where) -> Any:
        thin = _thin()
        thing: Any = _Thing(size=count)
        placed = thin.points(thing, at, rules, held_out=held_out)
        if placed is None:
            return None
        round_ = [
            mesh.corner_normal is not None
            and bool((mesh.corner_normal == mesh.vertices[mesh.triangles]).all())
            for mesh in thin.meshes
        ]
        return {
            "mesh": placed.mesh.tolist(),
            "placed": placed.world_from_mesh.tolist(),
            "holdout": bool(placed.holdout),
            "round": round_,
        }

    several = _thin()
    made = several.hair(_Thing(slots=(0, 1, 5, 2)), where, (1, 0, 2), held_out=False)
    twice = _thin()
    for number in (1, 2):
        twice.curves(_Thing(number), where, THERE, held_out=False)
    return {
        kind: {
            "there": numbers(kind, THERE),
            "gone": numbers(kind, GONE),
            "holdout": numbers(kind, HOLDOUT),
            "there in a holdout": numbers(kind, THERE, held_out=True),
            "holdout in a holdout": numbers(kind, HOLDOUT, held_out=True),
            "gone in a holdout": numbers(kind, GONE, held_out=True),
            "not drawn": numbers(kind, THERE, renders_hair=False),
            "flat": numbers(kind, THERE, at=flat),
        }
        for kind in ("hair", "curves")
    } | {
        "several": [
            made,
            [len(mesh.triangles) for mesh in several.meshes],
            several.has_thin_meshes,
        ],
        "no system": [numbers("hair", THERE, thing=_Thing()), _thin().has_thin_meshes],
        "flat normals": several.meshes[0].corner_normal is None,
        "by subdivisions": [triangles(subdivisions=n) for n in range(6)],
        "thick": [triangles(shape=shape) for shape in ("THICK", "THICK_LINEAR")],
        "straight": triangles(_Thing(2)),
        "two meshes of one object": [len(mesh.triangles) for mesh in twice.meshes],
        "wide view": [
            triangles(shape="THICK", camera=_orthographic(scale)) for scale in (6.0, 600.0)
        ],
        "points": scattered(3, THERE),
        "points of a holdout": scattered(1, HOLDOUT),
        "points in a holdout": scattered(1, THERE, held_out=True),
        "no points": scattered(0, THERE),
        "flat points": scattered(1, THERE, at=flat),
        "points that are gone": scattered(1, GONE),
    }


def _orthographic(scale: float) -> Any:
    return replace(CAMERA, type="ORTHO", ortho_scale=scale)


if __name__ == "__main__":
    sys.exit(main())
