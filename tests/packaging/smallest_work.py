"""The smallest real work of every command group, as command lines of an installation.

python tests/packaging/smallest_work.py LEGOWORLD EXAMPLES DATASETS, in an empty folder: the
program, and where the installation's catalogue is.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import bpy

scene = bpy.context.scene
scene.render.resolution_x, scene.render.resolution_y = 64, 48
cube = bpy.data.objects["Cube"]
cube["category"] = "chair"
scene.camera["view"] = "0"
bpy.ops.mesh.primitive_plane_add(size=20, location=(0, 0, -1))
"""


def main(legoworld: str, examples: Path, datasets: Path) -> None:
    """Run the steps in order; the first that fails ends it with what it printed."""
    data = datasets / "skimage_examples"
    truth = str(data / "truth_coco.json")
    photos = Path("photos")
    photos.mkdir()
    for picture in examples.glob("*/final.png"):
        (photos / f"{picture.parent.name}.png").write_bytes(picture.read_bytes())
    Path("program.py").write_text(PROGRAM, encoding="utf-8")
    regions = [{"category": "chair", "outline_px": [[8, 8], [40, 8], [40, 40]]}]
    Path("regions.json").write_text(json.dumps(regions), encoding="utf-8")
    steps = [
        "doctor", "list tasks", "list datasets", "list baselines", "list schema", "agent list",
        "execute program.py -o scenes/one", "freeze scenes", "inspect scenes/one -o look",
        f"track make --task coco --truth {truth} -o track.json",
        "readout --task coco --track track.json -o run",
        "merge run -o merged", "export run --format coco -o exported.json",
        f"evaluate run --truth {truth} -o eval", "evidence verify eval",
        "baseline import run/predictions.json --task coco --track track.json "
        "--category-ids dataset -o other",
        f"evaluate other --truth {truth} -o eval-other",
        "compare eval eval-other -o comparison", "report comparison --photos photos -o page.html",
        f"score {examples}/coffee --photo photos/coffee.png --truth {truth} -o scored",
        "bench make scenes -o bench --size 64x48 --samples 1 --noise-seeds 0 --keep-scenes itself",
        "readout itself --task bench --track bench/public/track.json -o bench-run",
        "evaluate bench-run --truth bench/private -o bench-eval",
        "bench reward bench-eval -o reward.json", "bench table bench-eval -o table",
        "bench export --harbor bench -o tasks", "bench serve bench --no-render",
        "demo -o demo",
        "blender --help", "plugin --help", "trajectory --help", "reconstruct --help",
    ]  # fmt: skip
    for step in steps:
        done = subprocess.run(
            [legoworld, *step.split()],
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
        )
        assert done.returncode == 0, f"{step}: {done.returncode}\n{done.stdout}\n{done.stderr}"
    print(len(steps))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]).absolute(), Path(sys.argv[3]).absolute())
