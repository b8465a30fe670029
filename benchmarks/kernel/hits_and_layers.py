"""Times what the kernel answers besides instance and depth, in units of one draw.

    python benchmarks/kernel/hits_and_layers.py [SCENES ...] [--rounds 31] [--threads 1]
        [--before CHECKOUT]

SCENES are scene folders, by default the shipped examples. Every round runs every row once, in a
random order; what is printed is the median CPU time of a row and the median of its ratios to the
draw of its own round. The row `alone` draws each instance by itself. --before: another checkout
with a compiled kernel, whose plain draw is timed too (it must draw the same bytes).
"""

from __future__ import annotations

import argparse
import ctypes
import dataclasses
import random
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import legoworld
from legoworld.visibility import kernel
from legoworld.visibility.kernel import Surfaces, render
from legoworld.visibility.layers import amodal_layers, direct_occluders, occluders
from legoworld.visibility.normals import render_normals
from legoworld.visibility.projection import Projection
from legoworld.visibility.view import View

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from visibility.kernel_hits import triangles

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def main() -> int:
    """Time every scene; see the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--rounds", type=int, default=31)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--before", type=Path)
    args = parser.parse_args()
    scenes = args.scenes or sorted(p.parent for p in EXAMPLES.glob("*/scene.blend"))
    for folder in scenes:
        time_scene(folder, args.rounds, args.threads, args.before)
    return 0


def time_scene(folder: Path, rounds: int, threads: int, before: Path | None) -> None:
    """Print the rows of one scene."""
    view: View = legoworld.open_scene(folder).view()._inspection.view
    surfaces, camera, size_wh = view.surfaces, view.projection, view.size_wh
    options: dict[str, Any] = {"threads": threads}
    given = (surfaces, camera, size_wh)
    layers = amodal_layers(*given, **options)
    singles = [_only(surfaces, i) for i in np.unique(layers.instance)]
    rows: dict[str, Callable[[], object]] = {
        "draw": lambda: render(*given, **options),
        "triangles": lambda: triangles(*given, **options),
        "barycentric": lambda: triangles(*given, **options, barycentric=True),
        "normals": lambda: render_normals(*given, **options),
        "layers": lambda: amodal_layers(*given, **options),
        "occluders": lambda: (occluders(layers), direct_occluders(layers)),
        "alone": lambda: [render(one, camera, size_wh, **options) for one in singles],
    }
    if before is not None:
        rows["before"] = draw_before(before, surfaces, camera, size_wh, options)
    cpu = measured(rows, rounds)
    print(
        f"{folder.name}: {size_wh[0]} x {size_wh[1]}, {len(singles)} instances with a pixel, "
        f"{len(layers.instance) / (size_wh[0] * size_wh[1]):.2f} layers, {threads} threads"
    )
    for name, times in cpu.items():
        ratio = statistics.median(a / b for a, b in zip(times, cpu["draw"], strict=True))
        print(f"    {name:12} {statistics.median(times) * 1e3:8.2f} ms CPU {ratio:7.2f} draws")


def measured(rows: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """CPU seconds of each row, a value a round, after one round that does not count."""
    cpu: dict[str, list[float]] = {name: [] for name in rows}
    order = random.Random(0)
    for number in range(rounds + 1):
        for name in order.sample(list(rows), len(rows)):
            begin = time.process_time()
            rows[name]()
            if number > 0:
                cpu[name].append(time.process_time() - begin)
    return cpu


def draw_before(
    checkout: Path, surfaces: Surfaces, camera: Projection, size_wh: tuple[int, int], options: Any
) -> Callable[[], object]:
    """The draw of another checkout's library, once compared with this one's."""
    loaded = ctypes.CDLL(str(next((checkout / "legoworld" / "visibility").glob("_kernel.*"))))

    def draw() -> tuple[Any, Any]:
        call = kernel.prepare(surfaces, camera, size_wh, 1.0, options["threads"])
        out = [kernel.on_cache_lines(size_wh[1], size_wh[0]) for _ in range(2)]
        pointers = [ctypes.c_void_p(one.ctypes.data) for one in out]
        loaded.lw_render(
            ctypes.byref(call.surfaces), ctypes.byref(call.view), ctypes.c_int32(call.threads),
            ctypes.c_int32(kernel.level()), *pointers, None,
        )  # fmt: skip
        return out[0], out[1]

    now = render(surfaces, camera, size_wh, **options)
    instance, depth = draw()
    if instance.tobytes() != now.instance.tobytes() or depth.tobytes() != now.depth_z_m.tobytes():
        raise SystemExit("the two checkouts draw different bytes")
    return draw


def _only(surfaces: Surfaces, instance_id: int) -> Surfaces:
    """One instance alone."""
    kept = surfaces.placement_id == instance_id
    return dataclasses.replace(
        surfaces,
        placement_mesh=surfaces.placement_mesh[kept],
        cam_from_mesh=surfaces.cam_from_mesh[kept],
        placement_id=surfaces.placement_id[kept],
    )


if __name__ == "__main__":
    raise SystemExit(main())
