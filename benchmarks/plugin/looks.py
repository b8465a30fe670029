"""Does the difference of photo and render, as `look` shows it, tell which object is off its place?

    python benchmarks/plugin/looks.py DATASET KEPT_SCENES [--only __hard__view_00] [--each 4]

One object of a scene is moved by 0.3 to 0.6 m along the ground, the scene is rendered as `look`
does, and its objects are ranked by the mean difference from the photo over the pixels that show
them. No region, depth or ground truth enters. With --relit every light of the edited scene has 0.7
to 1.4 times its power: then all objects differ.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from copies import SMALLEST_PX

from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.plugin.entities import Entities
from legoworld.plugin.measure import surface_pixels, surface_view
from legoworld.plugin.small_render import render_copy
from legoworld.plugin.state import read_live
from legoworld.readouts.pictures import read_photo
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.pictures import decoded_picture

PANE_PX = 256
EDIT = """
import random, sys
import bpy
blend, output, name, x, y, relit = sys.argv[1:]
bpy.ops.wm.open_mainfile(filepath=blend)
moved = bpy.data.objects[name]
moved.matrix_world.translation.x += float(x)
moved.matrix_world.translation.y += float(y)
chance = random.Random(name)
if relit == "True":
    for light in bpy.data.lights:
        light.energy *= chance.uniform(0.7, 1.4)
bpy.ops.wm.save_as_mainfile(filepath=output, relative_remap=True)
"""


def main() -> None:
    """Move objects, render, rank, print the shares."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--only", default="__hard__view_00")
    parser.add_argument("--each", type=int, default=4, help="moved objects of each scene")
    parser.add_argument("--relit", action="store_true")
    chosen = parser.parse_args()
    dataset = read_dataset(chosen.dataset / "private")
    places: list[tuple[int, int]] = []
    with tempfile.TemporaryDirectory() as made, BlenderProcess(Limits(time_s=600)) as blender:
        for case in dataset.cases.values():
            if chosen.only not in case.stem:
                continue
            blend = chosen.scenes / case.stem / "scene.blend"
            own = read_live(blend, blender)
            size = (PANE_PX, round(PANE_PX * case.size_wh[1] / case.size_wh[0]))
            photo = cv2.resize(
                read_photo(dataset.folders.reference(case)), size, interpolation=cv2.INTER_AREA
            )
            entities, seen = Entities(own.snapshot), surface_view(own, case.size_wh)
            names = [
                item.name
                for item in own.snapshot.objects
                if item.properties
                and (surfaces := entities.surfaces(item.name)) is not None
                and surface_pixels(surfaces, seen).sum() >= SMALLEST_PX
            ]
            random = np.random.default_rng(0)
            for name in random.permutation(names)[: chosen.each].tolist():
                angle, far = random.uniform(0, 2 * np.pi), random.uniform(0.3, 0.6)
                edited = Path(made) / "edited.blend"
                given = [str(far * np.cos(angle)), str(far * np.sin(angle)), str(chosen.relit)]
                subprocess.run(
                    [sys.executable, "-c", EDIT, str(blend), str(edited), name, *given],
                    check=True,
                    stdout=subprocess.DEVNULL,
                )
                live = read_live(edited, blender)
                png = render_copy(edited, blender, size, samples=16, denoise=True)
                picture = decoded_picture(png, color=True)
                assert picture is not None
                apart = np.abs(picture[:, :, ::-1].astype(np.int16) - photo).max(axis=2)
                now, shown = Entities(live.snapshot), surface_view(live, size)
                means = {}
                for other in names:
                    mask = surface_pixels(now.surfaces(other), shown)
                    if mask.sum() >= SMALLEST_PX // 4:
                        means[other] = float(apart[mask].mean())
                if name in means:
                    order = sorted(means, key=lambda n: -means[n])
                    places.append((order.index(name), len(order)))
            print(f"{case.stem}: {len(names)} objects", flush=True)
    first = np.mean([place == 0 for place, _ in places])
    three = np.mean([place < 3 for place, _ in places])
    chance = np.mean([1 / n for _, n in places])
    print(
        f"{len(places)} moved objects: first by the difference {first:.0%}, among three "
        f"{three:.0%}; by chance {chance:.0%} and {3 * chance:.0%}"
    )


if __name__ == "__main__":
    main()
