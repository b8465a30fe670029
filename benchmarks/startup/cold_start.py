"""One scene from a cold start, against Blender's module opening the same file, side by side.

    python benchmarks/startup/cold_start.py SCENE_FOLDER [--rounds 9]

Prints the median of per-round ratios to `python -c "import bpy; ...open_mainfile(...)"`: with
nothing cached (target: at most 1.2) and with the snapshot cached (target: under 0.33).
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def seconds(command: list[str]) -> float:
    """Wall time of a whole process that must succeed."""
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--rounds", type=int, default=9)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(arguments.scene, folder / "scenes" / "one")
        blend = str(folder / "scenes" / "one" / "scene.blend")
        bpy = [sys.executable, "-c", f"import bpy; bpy.ops.wm.open_mainfile(filepath={blend!r})"]
        bare = [sys.executable, "-c", "import numpy, click"]

        def readout(*cache: str) -> float:
            shutil.rmtree(folder / "run", ignore_errors=True)
            command = [sys.executable, "-m", "legoworld", "readout", str(folder / "scenes")]
            return seconds([*command, "--task", "coco", "-q", "-o", str(folder / "run"), *cache])

        cached = ("--cache", str(folder / "cache"))
        readout(*cached)
        rounds = [
            (seconds(bpy), readout("--no-cache"), readout(*cached), seconds(bare))
            for _ in range(arguments.rounds)
        ]
    print(f"{'':34}{'seconds':>9}{'ratio':>8}")
    names = ("import bpy and open", "readout, nothing cached", "readout, snapshot cached",
             "import numpy and click only")  # fmt: skip
    for place, what in enumerate(names):
        middle = statistics.median(r[place] for r in rounds)
        ratio = statistics.median(r[place] / r[0] for r in rounds)
        print(f"{what:34}{middle:9.2f}{ratio:8.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
