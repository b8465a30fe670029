"""IoU of boxes in space: ours against SciPy's half-spaces and Sutherland-Hodgman clipping in NumPy.

    python benchmarks/boxes3d/iou.py [--boxes 60]

Pairs of random boxes, turned in every direction, of which about two thirds overlap. Prints
microseconds of CPU a pair, the ratio to ours, and the largest difference from ours. SciPy's needs a
point inside both boxes, which a linear program finds; that is about half of its time.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from evaluation.solids import box, rotation, scipy_iou  # noqa: E402

from legoworld.evaluation.box_overlaps import box_ious  # noqa: E402

Floats = NDArray[np.float64]
_LOOPS = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (3, 7, 6, 2), (0, 4, 7, 3), (1, 2, 6, 5))


def clipped_iou(one: Floats, other: Floats) -> float:
    """Each face of either box cut by the other's planes; the volume by the divergence theorem."""
    common = _enclosed(one, other) + _enclosed(other, one)
    volumes = [_enclosed(corners, None) for corners in (one, other)]
    return common / (sum(volumes) - common)


def _faces(corners: Floats) -> list[tuple[Floats, Floats, Floats]]:
    """Loop, outward unit normal and a point of each face."""
    faces = []
    for loop in _LOOPS:
        points = corners[list(loop)]
        normal = np.cross(points[2] - points[0], points[3] - points[1])
        faces.append((points, normal / np.linalg.norm(normal), points.mean(axis=0)))
    return faces


def _enclosed(corners: Floats, other: Floats | None) -> float:
    """What the faces of a box, as far as they lie in another, add to an enclosed volume."""
    total, planes = 0.0, [] if other is None else _faces(other)
    for points, normal, on in _faces(corners):
        polygon = points
        for _, across, at in planes:
            polygon = _clip(polygon, (polygon - at) @ across)
            if len(polygon) < 3:
                break
        else:
            fan = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
            total += float(normal @ fan.sum(axis=0)) / 2 * float(normal @ on) / 3
    return total


def _clip(polygon: Floats, above: Floats) -> Floats:
    kept = []
    for k in range(len(polygon)):
        n = (k + 1) % len(polygon)
        if above[k] <= 0:
            kept.append(polygon[k])
        if (above[k] > 0) != (above[n] > 0):
            share = above[k] / (above[k] - above[n])
            kept.append(polygon[k] + (polygon[n] - polygon[k]) * share)
    return np.array(kept).reshape(-1, 3)


def _timed(measure: Callable[[], Floats]) -> tuple[float, Floats]:
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        values = measure()
        best = min(best, time.process_time() - start)
    return best * 1e6 / values.size, values


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boxes", type=int, default=60)
    n = parser.parse_args().boxes
    random = np.random.default_rng(0)
    made = [
        box(random.normal(size=3) * 0.4, random.uniform(0.2, 1.5, 3), rotation(random))
        for _ in range(2 * n)
    ]
    mine, theirs = np.array(made[:n]), np.array(made[n:])
    ours_us, ours = _timed(lambda: box_ious(mine, theirs))
    print(f"{n * n} pairs, {np.mean(ours > 0):.0%} overlap")
    print(f"ours: {ours_us:.2f} us a pair")
    others = {"SciPy half-spaces": scipy_iou, "NumPy clipping": clipped_iou}
    for name, iou in others.items():
        us, values = _timed(lambda iou=iou: np.array([[iou(a, b) for b in theirs] for a in mine]))
        worst = np.abs(values - ours).max()
        print(f"{name}: {us:.0f} us a pair, {us / ours_us:.0f}x, differs by {worst:.1e}")


if __name__ == "__main__":
    main()
