"""How well the lines of a bench's pictures tell the camera's rotation.

    python benchmarks/plugin/rotations.py DATASET KEPT_SCENES

DATASET and KEPT_SCENES: of `legoworld bench make ... --keep-scenes KEPT_SCENES`. The field of view
is given, as the track gives it; the true rotation is of the kept scene's camera. Errors are turns
between both, whichever horizontal axis is called x. A row per family: cases, unknown, median, 90 %
and largest error in degrees, and how many are off by more than 5 degrees.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from legoworld.plugin.state import read_live
from legoworld.plugin.vanishing_points import UndeterminedError, manhattan_camera
from legoworld.readouts.pictures import read_photo
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.visibility.camera import projection

F64 = NDArray[np.float64]
WRONG_DEG = 5.0


def error_deg(estimate: F64, truth: F64) -> float:
    """The smallest turn between two rotations to a z-up world, modulo quarter turns about z."""
    cosines = []
    for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        named = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ estimate
        cosines.append((float(np.trace(named @ truth.T)) - 1) / 2)
    return math.degrees(math.acos(min(1.0, max(-1.0, max(cosines)))))


def error_of(picture: Path, blend: Path, blender: BlenderProcess) -> float | str:
    """The error on one picture, degrees; the reason where it is unknown."""
    import cv2

    photo = read_photo(picture)
    height, width = photo.shape[:2]
    snapshot = read_live(blend, blender).snapshot
    focal = projection(snapshot.camera, snapshot.render, (width, height)).fx
    truth = np.array(snapshot.camera.world_from_camera)[:, :3]
    gray = np.asarray(cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY), np.uint8)
    try:
        found = manhattan_camera(gray, math.degrees(2 * math.atan(width / 2 / focal)))
    except UndeterminedError as error:
        return str(error)
    return error_deg(found.world_from_cam, truth)


def tell(title: str, results: list[float | str]) -> None:
    """One line of the table."""
    errors = np.array([result for result in results if isinstance(result, float)])
    line = f"{title:14} {len(results):3} cases  {len(results) - len(errors):2} unknown"
    if len(errors):
        line += (
            f"  median {np.median(errors):.2f}  90 % {np.quantile(errors, 0.9):.2f}"
            f"  largest {errors.max():.2f}  wrong {int((errors > WRONG_DEG).sum())}"
        )
    print(line, flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    chosen = parser.parse_args()
    by_family: dict[str, list[float | str]] = {}
    begun = time.process_time()
    with BlenderProcess(Limits(time_s=600)) as blender:
        for picture in sorted((chosen.dataset / "public" / "images").glob("*.png")):
            result = error_of(picture, chosen.scenes / picture.stem / "scene.blend", blender)
            by_family.setdefault(picture.stem.partition("__")[0], []).append(result)
            if isinstance(result, str) or result > WRONG_DEG:
                print(f"{picture.stem}: {result}", flush=True)
    for family, results in by_family.items():
        tell(family, results)
    tell("all", [result for results in by_family.values() for result in results])
    print(f"{time.process_time() - begun:.1f} CPU s, Blender's not counted")


if __name__ == "__main__":
    main()
