"""Make submissions from kept reference cases: as they are, or changed in one way.

    python examples/bench/submit.py itself -o submissions --change scale --amount 0.03

itself: what `legoworld bench make --keep-scenes` wrote. The changes, --amount and its default:

    none       the reference itself
    camera     the camera moves sideways, metres [0.1]
    scale      the world grows about the camera, share [0.02]
    delete     every n-th scored thing is gone [2]
    duplicate  every n-th scored thing stands twice, half its width apart [2]
    swap       the meshes of things change places, of every n-th pair by name [1]
    move       every thing moves over the ground, metres, in a direction of its own [0.1]
    turn       every thing turns about its upright axis, degrees [15]
    noise      every vertex moves by a Gaussian, metres [0.02]
    hollow     every n-th thing loses the faces that the camera does not see [2]
    relabel    every n-th thing has the labels of the next thing of another category [2]
    paint      every n-th thing has a plain colour of its own [2]
    another    the next family's scene of the same tier and view [any]
"""

from __future__ import annotations

import argparse
import colorsys
import json
import logging
import math
import random
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

# isort: split
import bmesh  # it comes with bpy
from mathutils import Matrix, Vector

DEFAULTS = {"none": 0.0, "camera": 0.1, "scale": 0.02, "delete": 2, "duplicate": 2, "swap": 1,
            "move": 0.1, "turn": 15, "noise": 0.02, "hollow": 2, "relabel": 2, "paint": 2,
            "another": 0}  # fmt: skip
#: What copies a kept case and opens no scene.
COPIES = ("none", "another")


def things() -> list[Any]:
    """The labelled things that a render shows, by name."""
    found = [o for o in bpy.context.scene.objects if "category" in o and not o.hide_render]
    return sorted(found, key=lambda o: o.name)


def meshes_of(thing: Any) -> list[Any]:
    """The mesh objects of a thing, itself included."""
    return [o for o in (thing, *thing.children_recursive) if o.type == "MESH"]


def camera(amount: float) -> None:
    """Sideways, along the camera's own x axis."""
    holder = bpy.context.scene.camera
    holder.matrix_world = holder.matrix_world @ Matrix.Translation((amount, 0.0, 0.0))


def scale(amount: float) -> None:
    """About the camera's place: the picture stays, every depth grows."""
    place = bpy.context.scene.camera.matrix_world.translation.copy()
    grown = (
        Matrix.Translation(place) @ Matrix.Scale(1.0 + amount, 4) @ Matrix.Translation(-place)
    )  # fmt: skip
    for thing in bpy.context.scene.objects:
        if thing.parent is None and thing.type not in ("CAMERA", "LIGHT"):
            thing.matrix_world = grown @ thing.matrix_world


def delete(amount: float) -> None:
    """Every n-th thing, with what belongs to it."""
    for thing in things()[:: max(1, int(amount))]:
        for part in (*thing.children_recursive, thing):
            part.hide_render = True


def duplicate(amount: float) -> None:
    """Every n-th thing once more, to its right."""
    for thing in things()[:: max(1, int(amount))]:
        for part in meshes_of(thing):
            copied = part.copy()
            bpy.context.scene.collection.objects.link(copied)
            copied.parent = None
            aside = Vector((part.dimensions.x / 2, 0.0, 0.0))
            copied.matrix_world = Matrix.Translation(aside) @ part.matrix_world


def swap(amount: float) -> None:
    """Neighbours by name show each other's mesh."""
    parts = [part for thing in things() for part in meshes_of(thing)[:1]]
    pairs = list(zip(parts[::2], parts[1::2], strict=False))
    for first, second in pairs[:: max(1, int(amount))]:
        first.data, second.data = second.data, first.data


def move(amount: float) -> None:
    """Seeded directions, all as long."""
    drawn = random.Random(0)
    for thing in things():
        angle = drawn.uniform(0.0, 2.0 * math.pi)
        aside = Vector((amount * math.cos(angle), amount * math.sin(angle), 0.0))
        thing.matrix_world = Matrix.Translation(aside) @ thing.matrix_world


def turn(amount: float) -> None:
    """About the middle of a thing's own origin, to the left and right in turn."""
    for number, thing in enumerate(things()):
        place = Matrix.Translation(thing.matrix_world.translation)
        angle = math.radians(amount if number % 2 else -amount)
        turned = place @ Matrix.Rotation(angle, 4, "Z") @ place.inverted()
        thing.matrix_world = turned @ thing.matrix_world


def hollow(amount: float) -> None:
    """Rays to each face's middle and, a tenth inwards, to its corners decide what is seen."""
    scene, graph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    eye = scene.camera.matrix_world.translation
    shown: dict[Any, list[int]] = {}
    for part in (p for thing in things()[:: max(1, int(amount))] for p in meshes_of(thing)):
        part.data = part.data.copy()
        for face in part.data.polygons:
            middle = part.matrix_world @ face.center
            corners = [part.matrix_world @ part.data.vertices[v].co for v in face.vertices]
            targets = (middle, *(corner.lerp(middle, 0.1) for corner in corners))
            if any(_sees(scene, graph, eye, target) for target in targets):
                shown.setdefault(part, []).append(face.index)
        hidden = set(range(len(part.data.polygons))) - set(shown.get(part, ()))
        mesh = bmesh.new()
        mesh.from_mesh(part.data)
        mesh.faces.ensure_lookup_table()
        bmesh.ops.delete(mesh, geom=[mesh.faces[i] for i in hidden], context="FACES")
        mesh.to_mesh(part.data)
        mesh.free()


def _sees(scene: Any, graph: Any, eye: Vector, target: Vector) -> bool:
    """Whether nothing is in front of a point; what is behind its own face does not count."""
    way = target - eye
    hit, place, *_ = scene.ray_cast(graph, eye, way.normalized(), distance=way.length * 1.001)
    return not hit or (place - eye).length > way.length - 1e-4 * way.length


def relabel(amount: float) -> None:
    """Names alone: no surface changes."""
    known = things()
    labels = [{k: t[k] for k in t.keys() if k.endswith("category")} for t in known]  # noqa: SIM118
    for i in range(0, len(known), max(1, int(amount))):
        others = (labels[(i + n) % len(known)] for n in range(1, len(known)))
        other = next((o for o in others if o["category"] != labels[i]["category"]), labels[i])
        for key in labels[i]:
            del known[i][key]
        for key, value in other.items():
            known[i][key] = value


def paint(amount: float) -> None:
    """Colours alone: a plain material, its hue by the thing's number."""
    for number, thing in enumerate(things()[:: max(1, int(amount))]):
        material = bpy.data.materials.new(f"Paint {number}")
        material.use_nodes = True
        color = colorsys.hsv_to_rgb(number * 0.381966 % 1.0, 0.8, 0.6)
        shader = material.node_tree.nodes["Principled BSDF"]
        shader.inputs["Base Color"].default_value = (*color, 1.0)
        for part in meshes_of(thing):
            part.data = part.data.copy()
            for slot in range(len(part.data.materials)):
                part.data.materials[slot] = material


def noise(amount: float) -> None:
    """Seeded, so that the same submission is made again."""
    drawn = random.Random(0)
    for mesh in sorted({p.data for t in things() for p in meshes_of(t)}, key=lambda m: m.name):
        for vertex in mesh.vertices:
            vertex.co += Vector(drawn.gauss(0.0, amount) for _ in range(3))


CHANGES: dict[str, Callable[[float], None]] = {
    "camera": camera, "scale": scale, "delete": delete, "duplicate": duplicate, "swap": swap,
    "move": move, "turn": turn, "noise": noise, "hollow": hollow, "relabel": relabel,
    "paint": paint,
}  # fmt: skip


def sources(cases: list[Path], change: str) -> list[Path]:
    """The kept case that each case's submission is made from."""
    if change != "another":
        return cases
    split = {case: case.name.partition("__") for case in cases}
    families = sorted({family for family, _, _ in split.values()})
    if len(families) < 2:
        sys.exit(f"--change another needs two families; there is only {', '.join(families)}")
    following = dict(zip(families, families[1:] + families[:1], strict=True))
    return [
        case.parent / f"{following[family]}__{view}" for case, (family, _, view) in split.items()
    ]


def submit(case: Path, output: Path, change: str, amount: float) -> None:
    """A kept case as a submission: scene.blend, scene.glb, final.png, provenance.json."""
    output.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(case / "final.png", output / "final.png")
    if change in COPIES:
        for name in ("scene.blend", "scene.glb"):
            shutil.copyfile(case / name, output / name)
    else:
        bpy.ops.wm.open_mainfile(filepath=str(case / "scene.blend"), load_ui=False)
        bpy.context.view_layer.update()
        CHANGES[change](amount)
        bpy.context.view_layer.update()
        bpy.ops.wm.save_as_mainfile(
            filepath=str(output / "scene.blend"), compress=True, check_existing=False
        )
        bpy.ops.export_scene.gltf(
            filepath=str(output / "scene.glb"), export_cameras=True, use_renderable=True
        )
    model = change if change in COPIES else f"{change} {amount:g}"
    told = {"agent": "examples/bench/submit.py", "model": model}
    (output / "provenance.json").write_text(json.dumps(told), encoding="utf-8")


def main() -> None:
    """Submissions of every case, or of those --only names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--change", choices=sorted(DEFAULTS), default="none")
    parser.add_argument("--amount", type=float)
    parser.add_argument("--only", help="only cases whose name holds this")
    chosen = parser.parse_args()
    logging.disable(logging.INFO)  # Blender's glTF add-on tells of every mesh
    amount = DEFAULTS[chosen.change] if chosen.amount is None else chosen.amount
    cases = sorted(p for p in chosen.cases.iterdir() if (p / "scene.blend").is_file())
    for case, source in zip(cases, sources(cases, chosen.change), strict=True):
        if not chosen.only or chosen.only in case.name:
            submit(source, chosen.output / case.name, chosen.change, amount)


if __name__ == "__main__":
    main()
