"""Times the visibility kernel beside its floor, two ray tracers and Cycles, interleaved.

    python benchmarks/kernel/run.py [--scenes spheres,objects] [--widths 640,1920] [--rounds 5]
        [--cycles-python PYTHON] [--slowest 30] [--most-rows 256]

Every round runs every contender once; ratios are taken within a round and their median is printed.
The benchmark stops unless the kernel's bytes are the same in every round and its depth agrees with
brute-force rays in float64. Competitors are optional: embreex, open3d, and a Python with bpy
(--cycles-python, the running one by default); what is absent is named. --most-rows keeps pictures
of 24 million pixels affordable: Embree and Open3D trace that many rows, spread evenly, and the time
of that is scaled to the whole picture; the build is not.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import contenders
import numpy as np
from bench_scenes import SCENES, SIZES, camera
from cycles_contender import Cycles

from legoworld.visibility.kernel import Surfaces
from legoworld.visibility.projection import Projection


@dataclass
class Times:
    """Seconds of one contender, a value a round."""

    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    added_mb: float = float("nan")


def brute_force_depth(surfaces: Surfaces, projection: Projection, pixels: np.ndarray) -> np.ndarray:
    """Planar z at some (row, column) pixels: each ray against every triangle, float64."""
    x = (pixels[:, 1] + 0.5 - projection.cx) / projection.fx
    y = (pixels[:, 0] + 0.5 - projection.cy) / projection.fy
    best = np.full(len(pixels), np.inf)
    for mesh, matrix in zip(surfaces.placement_mesh, surfaces.cam_from_mesh, strict=True):
        v = surfaces.vertices[surfaces.vertex_start[mesh] : surfaces.vertex_start[mesh + 1]]
        t = surfaces.triangles[surfaces.triangle_start[mesh] : surfaces.triangle_start[mesh + 1]]
        p = (v @ matrix[:, :3].T + matrix[:, 3])[t]
        origin, e1, e2 = -p[:, 0], p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        turned = np.cross(origin, e1)
        top = np.einsum("ij,ij->i", turned, e2)
        for i in range(len(pixels)):
            ray = np.array([x[i], y[i], 1.0])
            across = np.cross(ray, e2)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                inverse = 1 / np.einsum("ij,ij->i", across, e1)
                u = np.einsum("ij,ij->i", origin, across) * inverse
                w = turned @ ray * inverse
                z = top * inverse
                hit = (u >= 0) & (w >= 0) & (u + w <= 1)
            hit &= (z >= projection.z_near) & (z <= projection.z_far)
            best[i] = min(best[i], z[hit].min(initial=np.inf))
    return best


def check(surfaces: Surfaces, projection: Projection, depth: np.ndarray, count: int) -> None:
    """Stops the benchmark when the kernel's depth is not the brute-force rays'."""
    rng = np.random.default_rng(0)
    pixels = np.stack([rng.integers(n, size=count) for n in depth.shape], axis=1)
    true = brute_force_depth(surfaces, projection, pixels)
    seen = depth[pixels[:, 0], pixels[:, 1]]
    same = np.isinf(true) & np.isinf(seen)
    with np.errstate(invalid="ignore"):
        same |= np.abs(seen - true) <= 1e-7 * true
    if not same.all():
        sys.exit(
            f"the kernel is wrong at {pixels[~same].tolist()}: {seen[~same]}, not {true[~same]}"
        )


def agreement(depth: np.ndarray, other: np.ndarray) -> float:
    """Share of pixels where both see nothing or the same z within 1e-4."""
    with np.errstate(invalid="ignore"):
        near = np.abs(depth - other) <= 1e-4 * np.abs(depth)
    return float(np.mean(near | (np.isinf(depth) & np.isinf(other))))


def run_case(scene: str, width: int, args: argparse.Namespace, skip: set[str]) -> dict[str, Times]:
    """All rounds of one scene and width; prints the agreement of every contender."""
    surfaces, size_wh = SCENES[scene](), SIZES[width]
    projection = camera(size_wh)
    ours = contenders.our_kernel(surfaces, projection, size_wh)
    ours.run()
    check(surfaces, projection, ours.depth, args.rays)
    digest = ours.digest()
    runs = {"kernel": ours, "floor": contenders.floor(surfaces, size_wh)}
    if "embreex" not in skip:
        runs["embreex"] = contenders.embree(surfaces, projection, size_wh, args.most_rows)
    if "open3d" not in skip:
        runs["open3d"] = contenders.open3d(surfaces, projection, size_wh, args.most_rows)
    times = {name: Times() for name in runs}
    times["kernel"].added_mb = added_mb(contenders.our_kernel(surfaces, projection, size_wh).run)
    with contextlib.ExitStack() as stack:
        cycles = None
        if "cycles" not in skip:
            cycles = stack.enter_context(Cycles(args.cycles_python, surfaces, size_wh))
            print(f"    cycles: same z at {agreement(ours.depth, cycles.depth()):.4%}")
            times["cycles"] = Times()
        for _ in range(args.rounds):
            for name, contender in runs.items():
                wall, cpu = time.perf_counter(), time.process_time()
                contender.run()
                wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
                times[name].wall.append(wall + contender.rest.wall_s)
                times[name].cpu.append(cpu + contender.rest.cpu_s)
            if cycles is not None:
                wall_s, cpu_s = cycles.render()
                times["cycles"].wall.append(wall_s)
                times["cycles"].cpu.append(cpu_s)
            if ours.digest() != digest:
                sys.exit(f"{scene} at {width}: the kernel's bytes changed between rounds")
    for name in ("embreex", "open3d"):
        if name in runs:
            step = runs[name].step
            rows = f", of every {step}th row" if step > 1 else ""
            print(
                f"    {name}: same z at {agreement(ours.depth[::step], runs[name].depth):.4%}{rows}"
            )
    return times


def added_mb(run: Callable[[], object]) -> float:
    """Peak resident memory that a call adds, its result included; NaN where /proc does not tell."""
    try:
        before = resident_mb("VmRSS")
        Path("/proc/self/clear_refs").write_text("5")  # the peak starts again
    except OSError:
        return float("nan")
    run()
    return resident_mb("VmHWM") - before


def resident_mb(which: str) -> float:
    """A line of /proc/self/status in MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(which)) / 1000


def ratio(times: dict[str, Times], name: str, what: str) -> str:
    """Median over the rounds of a contender's seconds by the kernel's; floor: the inverse."""
    if name not in times:
        return "-"
    ours, other = getattr(times["kernel"], what), getattr(times[name], what)
    values = np.divide(ours, other) if name == "floor" else np.divide(other, ours)
    return f"{np.median(values):.1f}x"


def absent(args: argparse.Namespace) -> set[str]:
    """Competitors that cannot run here or were not asked for, each named on the way."""
    skip = {name for name in ("embreex", "open3d", "cycles") if name not in args.against}
    for name in sorted({"embreex", "open3d"} - skip):
        if reason := contenders.why_absent(name):
            print(f"absent: {name} (pip install {name}): {reason}")
            skip.add(name)
    own = args.cycles_python == sys.executable
    if "cycles" not in skip and own and importlib.util.find_spec("bpy") is None:
        print("absent: cycles (pass --cycles-python a Python that has bpy)")
        skip.add("cycles")
    return skip


def names(text: str) -> list[str]:
    """Words between commas."""
    return text.split(",")


def arguments() -> argparse.Namespace:
    formatter = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=formatter)
    parser.add_argument("--scenes", default=[*SCENES], type=names)
    parser.add_argument("--widths", default=[*map(str, SIZES)], type=names)
    parser.add_argument("--rounds", default=5, type=int)
    parser.add_argument("--rays", default=12, type=int, help="pixels checked by brute force")
    parser.add_argument("--against", default=["embreex", "open3d", "cycles"], type=names)
    parser.add_argument("--most-rows", type=int, help="rows that ray tracers trace; time is scaled")
    parser.add_argument("--cycles-python", default=sys.executable)
    parser.add_argument("--slowest", default=30.0, type=float, help="expected seconds a render")
    return parser.parse_args()


def print_table(rows: list[tuple[str, int, dict[str, Times]]]) -> None:
    columns = [("floor", "cpu"), ("embreex", "cpu"), ("open3d", "cpu"), ("cycles", "wall")]
    heads = ["scene", "width", "kernel wall ms", "CPU ms", "added MB", "over floor, CPU"]
    heads += ["embreex, CPU", "Open3D, CPU", "Cycles, wall"]
    print("\n| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for scene, width, times in rows:
        ours = times["kernel"]
        cells = [scene, str(width)]
        cells += [f"{np.median(values) * 1e3:.1f}" for values in (ours.wall, ours.cpu)]
        cells.append(f"{ours.added_mb:.0f}")
        cells += [ratio(times, name, what) for name, what in columns]
        print("| " + " | ".join(cells) + " |")


def main() -> None:
    args = arguments()
    never = absent(args)
    widths = [int(width) for width in args.widths]
    rows = []
    for scene in args.scenes:
        skip = set(never)
        for width, wider in zip(widths, [*widths[1:], 0], strict=True):
            print(f"{scene} at {width}", flush=True)
            times = run_case(scene, width, args, skip)
            rows.append((scene, width, times))
            for name in sorted(times.keys() - {"kernel", "floor"}):
                expected = np.median(times[name].wall) * (wider / width) ** 2
                if expected > args.slowest:
                    print(f"    {name}: left out above {width}, about {expected:.0f} s a render")
                    skip.add(name)
    print_table(rows)


if __name__ == "__main__":
    main()
