"""Run with a Python that has bpy: small scenes made here, read while they are open.

Prints one JSON object; `test_reads_in_bpy.py` says what belongs in it.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from typing import Any

import bpy
from cases.stage import (
    camera,
    collection,
    empty,
    fresh,
    instance_of,
    link,
    material,
    nodes,
    points,
    polygons,
    scatter,
    square,
)

from legoworld.errors import LegoWorldError
from legoworld.scene.blender.extract import read_open_snapshot
from legoworld.scene.blender.open_file import OpenFile


def main() -> int:
    """See the module's docstring."""
    made: dict[str, Callable[[], object]] = {
        "shared": _shared, "slots": _slots, "types": _types, "labels": _labels, "layers": _layers,
        "override there": lambda: _override("opaque"), "override gone": lambda: _override("gone"),
        "instances": _instances, "thin": _thin, "adaptive": _adaptive, "far": lambda: _far(1e15),
    }  # fmt: skip
    told = {name: _read(build) for name, build in made.items()}
    told["broken"] = {name: _read(build) for name, build in _BROKEN.items()}
    told["cameras"] = {name: _read(lambda of=of: _camera(of)) for name, of in _CAMERAS.items()}
    print("\n" + json.dumps(told))
    return 0


def _read(build: Callable[[], object]) -> Any:
    """Surfaces as [object, triangles, holdout], meshes, warnings and labels; or the refusal."""
    fresh()
    build()
    opened = OpenFile(scene=bpy.context.scene, n_scenes=len(bpy.data.scenes), warnings=["before"])
    try:
        read = read_open_snapshot(opened)
    except LegoWorldError as error:
        return [error.code, error.what, error.found]
    count = (read.triangle_start[1:] - read.triangle_start[:-1]).tolist()
    shown = [read.objects[i].name for i in read.occurrence_object[read.surface_occurrence]]
    folders, rows = read.collections, read.occurrence_object.tolist()
    makers = read.occurrence_instancer.tolist()
    made = sorted(
        read.objects[rows[i]].name + (f" by {read.objects[rows[maker]].name}" if maker >= 0 else "")
        for i, maker in enumerate(makers)
    )
    frames: dict[str, set[tuple[int, ...]]] = {}
    for row, *made_by in zip(rows, makers, read.occurrence_frame.tolist(), strict=True):
        frames.setdefault(read.objects[row].name, set()).add(tuple(made_by))
    placed = {
        read.objects[rows[o]].name: [[round(float(x), 4) for x in row] for row in matrix]
        for o, matrix in zip(read.surface_occurrence, read.world_from_mesh, strict=True)
    }
    held_out = map(bool, read.surface_holdout)
    surfaces = zip(shown, (count[i] for i in read.surface_mesh), held_out, strict=True)
    return {
        "surfaces": sorted(map(list, surfaces)),
        "meshes": len(count),
        "warnings": list(read.warnings),
        "labels": {o.name: o.properties for o in (*read.objects, *folders) if o.properties},
        "parents": {c.name: [folders[i].name for i in c.parents] for c in folders},
        "held": {o.name: [folders[i].name for i in o.collections] for o in read.objects},
        "made": made,
        "apart": {name: len(of) for name, of in frames.items()},
        "placed": placed,
        "layer": [read.render.scene_name, read.render.view_layer],
        "camera": [read.camera.name, [c.name for c in read.cameras]],
    }


def _gone() -> Any:
    return material("gone", Alpha=0.0)


def _holdout() -> Any:
    made = material("holdout")
    tree = made.node_tree
    shader = tree.nodes.new("ShaderNodeHoldout")
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return made


def _shared() -> None:
    """Five objects of one mesh: two alike, and of others materials are the object's own."""
    camera((0, 0, 9))
    first = square("First")
    first.data.materials.append(material("opaque"))
    own = {"Second": None, "Third": _gone(), "Fourth": _holdout(), "Fifth": material("also opaque")}
    for name, shader in own.items():
        other = link(bpy.data.objects.new(name, first.data))
        if shader is not None:
            other.material_slots[0].link = "OBJECT"
            other.material_slots[0].material = shader
        if name == "Second":
            other.is_holdout = True


def _slots() -> None:
    """Five quads in a row by slots: opaque, gone, held out, empty, and one beyond the last."""
    camera((0, 0, 9))
    corners = [(x, y, 0.0) for x in range(6) for y in range(2)]
    made = polygons("Row", corners, [(2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1) for i in range(5)])
    for shader in (material("opaque"), _gone(), _holdout(), None, _gone()):
        made.data.materials.append(shader)
    made.data.polygons.foreach_set("material_index", [0, 1, 2, 3, 9])
    half = polygons("Half", corners, [(0, 2, 3), (4, 6, 7), (8, 10, 11)])
    half.data.materials.append(_gone())
    half.data.materials.append(material("opaque too"))
    half.data.polygons.foreach_set("material_index", [1, 0, 1])


def _instances() -> None:
    """Collections in collections, on vertices, by nodes and by particles; a curve with a mesh."""
    camera((0, 0, 9))
    inner, outer = collection("Inner", None), collection("Outer", None)
    square("Leaf", 1, inner)
    instance_of(inner, "Twig", 0, 0, outer)
    square("Stem", 1, outer)
    instance_of(outer, "Tree", 40, 30)
    unused = empty("Unused")
    unused.instance_type = "COLLECTION"
    plate = square("Plate", 4)
    plate.instance_type, plate.show_instancer_for_render = "VERTS", False
    square("Dot").parent = plate
    scattered = collection("Scattered", None)
    square("Chip", 1, scattered)
    scatter(points("Field", [(0, 0), (9, 9)]), thing=bpy.data.objects["Chip"])
    _blow(square("Blower", 4))
    _line("Line")
    bush = points("Bush", [(0, 0), (9, 9)], collection=outer)
    scatter(bush, thing=bpy.data.objects["Chip"])
    bush.modifiers.new("Smooth", "SMOOTH")
    _blow(square("Puff", 4, outer))
    _line("Wire", outer)
    turned = square("Turned")
    turned.rotation_euler.z, turned.scale, turned.location = math.pi / 2, (2, 3, 4), (5, 6, 7)
    bpy.context.scene.frame_set(1)


def _blow(from_: Any) -> None:
    """Give an object two particles that are chips."""
    from_.modifiers.new("Blow", "PARTICLE_SYSTEM")
    settings = from_.particle_systems[0].settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime = 2, 0, 0, 100
    settings.render_type, settings.instance_object = "OBJECT", bpy.data.objects["Chip"]


def _line(name: str, within: Any = None) -> None:
    """A curve with an extruded edge."""
    made = link(bpy.data.objects.new(name, bpy.data.curves.new(name, "CURVE")), within)
    made.data.extrude = 1
    made.data.splines.new("POLY").points.add(1)
    made.data.splines[0].points[1].co = (1, 0, 0, 1)


def _thin() -> None:
    """Hair curves and particle hair, each once more, gone and held out by its material; points."""
    camera((0, 0, 9))
    hair = bpy.data.hair_curves.new("Hair")
    hair.add_curves([2])
    hair.position_data.foreach_set("vector", [0, 0, 1, 0, 2, 1])
    for name in ("Cloud", "Cloud held out"):
        cloud = points(name, [(0, 0), (9, 9)])
        cloud.is_holdout = name != "Cloud"
        tree, given, result = nodes(name)
        spheres = tree.nodes.new("GeometryNodeMeshToPoints")
        tree.links.new(given.outputs[0], spheres.inputs[0])
        tree.links.new(spheres.outputs[0], result.inputs[0])
        cloud.modifiers.new("Points", "NODES").node_group = tree
    furry = square("Furry")
    furry.modifiers.new("Fur", "PARTICLE_SYSTEM")
    fur = furry.particle_systems[0].settings
    fur.type, fur.count, fur.hair_step = "HAIR", 3, 2
    for data in (hair, furry.data):
        data.materials.append(material("opaque"))
        link(bpy.data.objects.new(data.name.title(), data)) if data is not furry.data else None
        for name, shader in (("gone", _gone()), ("held out", _holdout())):
            other = furry.copy() if data is furry.data else bpy.data.objects.new("o", data)
            link(other).name = f"{data.name.title()} {name}"
            other.material_slots[0].link = "OBJECT"
            other.material_slots[0].material = shader
    unseen = furry.copy()
    link(unseen).name = "Furry of hair alone"
    unseen.show_instancer_for_render = False


def _types() -> None:
    camera((0, 0, 9))
    square("Square")
    data = bpy.data
    for name, made in {
        "Drawing": data.grease_pencils.new("g"), "Volume": data.volumes.new("v"),
        "Bones": data.armatures.new("b"), "Lamp": data.lights.new("l", "SUN"), "Nothing": None,
        "Lattice": data.lattices.new("l"), "Sound": data.speakers.new("s"),
        "Probe": data.lightprobes.new("p", "PLANE"), "Cloud": data.pointclouds.new("c"),
        "Line": data.curves.new("c", "CURVE"), "Loose": data.meshes.new("m"),
    }.items():  # fmt: skip
        link(data.objects.new(name, made))
    text = data.curves.new("t", "FONT")
    text.body = "I"
    link(data.objects.new("Text", text))
    sheet = data.curves.new("s", "SURFACE")
    sheet.splines.new("NURBS").points.add(1)
    link(data.objects.new("Sheet", sheet))
    ball = data.metaballs.new("m")
    ball.elements.new()
    link(data.objects.new("Ball", ball))
    hidden = link(data.objects.new("Hidden drawing", data.grease_pencils.new("h")))
    hidden.hide_render = True


def _labels() -> None:
    camera((0, 0, 9))
    outer = collection("Outer", category="room")
    inner, other = collection("Inner", outer), collection("Other")
    other.children.link(inner)
    made = square("Thing", 1, inner, category="chair", lvis_category=7, category_old="x", size="y")
    other.objects.link(made)
    made["raw_category"], made["odd_category"] = b"st\xffl", [1, 2]
    empty("Mark", other, coco_category=0.5)


def _layers() -> None:
    camera((0, 0, 9)).name = "Main"
    camera((0, 0, 9)).name = "Another"
    scene = bpy.context.scene
    scene.camera = bpy.data.objects["Main"]
    square("Square")
    scene.view_layers[0].name, scene.view_layers[0].use = "Off", False
    for name in ("Second", "Third"):
        scene.view_layers.new(name)
    scene.view_layers["Second"].use_solid = False
    bpy.data.scenes.new("Other")


def _override(kind: str) -> None:
    camera((0, 0, 9))
    square("Square").data.materials.append(_gone())
    square("Bare")
    bpy.context.view_layer.material_override = _gone() if kind == "gone" else material("o")


def _adaptive() -> None:
    camera((0, 0, 9))
    for name, adaptive in (("Fine", True), ("Coarse", False)):
        made = square(name)
        modifier = made.modifiers.new("Subdivision", "SUBSURF")
        modifier.levels, modifier.render_levels, modifier.subdivision_type = 0, 1, "SIMPLE"
        modifier.use_adaptive_subdivision = adaptive


def _far(x: float) -> None:
    """A triangle, and an object, with a coordinate of x in either direction."""
    camera((0, 0, 9))
    polygons("Triangle", [(0, 0, 0), (x, 0, 0), (0, -x, 0)], [(0, 1, 2)])
    square("Square").location.x = -x


def _lost() -> None:
    camera((0, 0, 9))
    for name, x in (("B", 2e15), ("A", -2e15), ("C", 0.0)):
        square(name).location.x = x
    empty("Without a surface").location.x = 1e18


_BROKEN: dict[str, Callable[[], object]] = {
    "vertices": lambda: _far(2e15),
    "a NaN": lambda: _far(math.nan),
    "places": _lost,
    "nothing": lambda: camera((0, 0, 9)),
    "no camera": lambda: square("Square"),
    "idle cameras": lambda: [camera((0, 0, 9)), square("S"), _set_camera(None)],
    "an empty": lambda: [square("S"), _set_camera(empty("Mark"))],
}


def _set_camera(to: Any) -> None:
    bpy.context.scene.camera = to


#: Settings of a camera; location and scale are its object's.
_CAMERAS: dict[str, dict[str, Any]] = {
    "plain": {},
    "panorama": {"type": "PANO"},
    "clip": {"clip_start": 5.0, "clip_end": 5.0},
    "clip just so": {"clip_start": 5.0, "clip_end": 5.001},
    "flat": {"scale": (1, 0, 1)},
    "small": {"scale": (1e-3, 1, -1)},
    "away": {"location": (0, 0, 2e15)},
    "as far as can be": {"location": (0, 0, 1e15)},
}


def _camera(settings: dict[str, Any]) -> None:
    made = camera((0, 0, 9))
    square("S")
    for key, value in settings.items():
        setattr(made if key in ("location", "scale") else made.data, key, value)


if __name__ == "__main__":
    sys.exit(main())
