"""Make submissions from kept reference cases: as they are, or changed in one way.

    python examples/bench/submit.py itself -o submissions --change scale --amount 0.03

itself: what `legoworld bench make --keep-scenes` wrote. The changes, --amount and its default:

    none       the reference itself
    camera     the camera moves sideways, metres [0.1]
    scale      the world grows about the camera, share [0.02]
    delete     every n-th scored thing is gone [2]
    duplicate  every n-th scored thing stands twice, half its width apart [2]
    swap       the meshes of things change places, in pairs [any]
    noise      every vertex moves by a Gaussian, metres [0.02]
    another    the next family's scene of the same tier and view [any]
"""

from __future__ import annotations

import argparse
import json
import logging
import random
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix, Vector

DEFAULTS = {"none": 0.0, "camera": 0.1, "scale": 0.02, "delete": 2, "duplicate": 2, "swap": 0,
            "noise": 0.02, "another": 0}  # fmt: skip
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


def swap(_amount: float) -> None:
    """Neighbours by name show each other's mesh."""
    parts = [part for thing in things() for part in meshes_of(thing)[:1]]
    for first, second in zip(parts[::2], parts[1::2], strict=False):
        first.data, second.data = second.data, first.data


def noise(amount: float) -> None:
    """Seeded, so that the same submission is made again."""
    drawn = random.Random(0)
    for mesh in sorted({p.data for t in things() for p in meshes_of(t)}, key=lambda m: m.name):
        for vertex in mesh.vertices:
            vertex.co += Vector(drawn.gauss(0.0, amount) for _ in range(3))


CHANGES: dict[str, Callable[[float], None]] = {
    "camera": camera, "scale": scale, "delete": delete, "duplicate": duplicate, "swap": swap,
    "noise": noise,
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
