"""Perturbed copies of kept cases, one Blender process for all of a plan.

python benchmarks/matrix/copies.py ITSELF -o COPIES --plan plan.json [--case kitchen__view_00]

A plan is a list of {"name", "changes": [[change, amount], ...], "oracles": [...], "scale_by":
{case: factor}}: changes are those of examples/bench/submit.py; an oracle then puts one thing back
as it was in the kept case: "camera", "labels", or "scale", the world about the camera by a factor.
scene.glb and final.png are the case's own: the bench checks them and scores neither.
"""

from __future__ import annotations

import argparse
import json
import logging
import shutil
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "bench"))

import bpy
import submit


def labels() -> dict[str, dict[str, str]]:
    """The labels of every object of the scene, by name."""
    return {
        thing.name: {k: thing[k] for k in thing.keys() if k.endswith("category")}  # noqa: SIM118
        for thing in bpy.context.scene.objects
    }


def restore_labels(kept: dict[str, dict[str, str]]) -> None:
    """As in the kept case, by the names of objects; what is new keeps its own."""
    for thing in bpy.context.scene.objects:
        if thing.name in kept:
            for key in [k for k in thing.keys() if k.endswith("category")]:  # noqa: SIM118
                del thing[key]
            for key, value in kept[thing.name].items():
                thing[key] = value


def copy_of(case: Path, output: Path, entry: dict[str, Any]) -> None:
    """One case of one entry of the plan."""
    output.mkdir(parents=True)
    for name in ("scene.glb", "final.png"):
        shutil.copyfile(case / name, output / name)
    bpy.ops.wm.open_mainfile(filepath=str(case / "scene.blend"), load_ui=False)
    bpy.context.view_layer.update()
    camera = bpy.context.scene.camera
    place, kept = camera.matrix_world.copy(), labels()
    for change, amount in entry["changes"]:
        submit.CHANGES[change](amount)
        bpy.context.view_layer.update()
    for oracle in entry.get("oracles", ()):
        if oracle == "camera":
            camera.matrix_world = place
        elif oracle == "labels":
            restore_labels(kept)
        else:
            submit.scale(entry["scale_by"][case.name] - 1.0)
        bpy.context.view_layer.update()
    bpy.ops.wm.save_as_mainfile(filepath=str(output / "scene.blend"), check_existing=False)


def main() -> None:
    """Every entry of the plan, of every case."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("itself", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--plan", type=Path, required=True)
    parser.add_argument("--case", action="append")
    chosen = parser.parse_args()
    logging.disable(logging.INFO)
    cases = sorted(p for p in chosen.itself.iterdir() if (p / "scene.blend").is_file())
    for entry in json.loads(chosen.plan.read_text("utf-8")):
        for case in cases:
            if not chosen.case or case.name in chosen.case:
                copy_of(case, chosen.output / entry["name"] / case.name, entry)


if __name__ == "__main__":
    main()
