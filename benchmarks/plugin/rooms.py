"""How well the plugin recovers rooms: python benchmarks/plugin/rooms.py [--rooms 30].

Random rooms with furniture, seen by a known camera (tests/plugin/synthetic.py). The rotation is
estimated from the picture's lines with the field of view given, the walls from the visible parts of
floor, walls and ceiling. Prints the rotations' errors in degrees, and relative errors of the
distances that are known, in camera heights.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from plugin.synthetic import (  # pyright: ignore[reportMissingImports]
    SIZE,
    camera,
    picture,
    room,
    seen_faces,
    true_distances,
)
from rotations import error_deg

from legoworld.plugin.room_fit import fit_box, rays
from legoworld.plugin.vanishing_points import UndeterminedError, manhattan_camera
from legoworld.records.plugin_evidence import Rows, Structure


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", type=int, default=30)
    errors, turns, unknown, untold, begun = [], [], 0, 0, time.process_time()
    for seed in range(parser.parse_args().rooms):
        random = np.random.default_rng(seed)
        world_from_cam, place = camera(random)
        hfov = random.uniform(45, 85)
        triangles = room(random)
        gray = picture(triangles, world_from_cam, place, hfov, random)
        try:
            estimate = manhattan_camera(gray, hfov).world_from_cam
        except UndeterminedError:
            untold += 1
            continue
        turns.append(error_deg(estimate, world_from_cam))
        seen = seen_faces(triangles, world_from_cam, place, hfov)
        labels: dict[Structure, NDArray[np.bool_]] = {
            "wall": (seen >= 0) & (seen < 4),
            "floor": seen == 4,
            "ceiling": seen == 5,
        }
        a, b, c = estimate.tolist()
        rotation: Rows = (tuple(a), tuple(b), tuple(c))
        fit = fit_box(rays(rotation, hfov, SIZE), labels)
        truth = true_distances(estimate, world_from_cam, place)
        for face in fit.faces:
            if face.distance is None:
                unknown += 1
            else:
                errors.append(abs(face.distance / truth[face.name] - 1))
    within = int((np.array(turns) <= 1).sum())
    print(f"rotation {len(turns)} known, {untold} unknown: median {np.median(turns):.2f} degrees, "
          f"within 1 degree {within}, largest {max(turns):.2f}")  # fmt: skip
    print(f"known    {len(errors)} distances, unknown {unknown}")
    print(f"median   {np.median(errors):.4f}")
    print(f"largest  {max(errors):.4f}, within 5 %: {np.mean(np.array(errors) <= 0.05):.3f}")
    print(f"CPU      {time.process_time() - begun:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
