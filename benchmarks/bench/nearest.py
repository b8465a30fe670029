"""Times the nearest-neighbour search beside k-d trees, on one core, interleaved.

    OMP_NUM_THREADS=1 python benchmarks/bench/nearest.py [--rounds 5] [--check 300]
        [--raster 421x237] [--nanoflann FOLDER]

Two surfaces of 421 x 237 points, the scoring raster of a 16:9 picture, or of --raster; every point
of each asks for the nearest of the other, wherever it is, and for what R's five tolerances need
("scipy within reach" is told the largest of them). A contender's time includes making its tree of
both, ours the index of both. Every round runs each contender once; CPU milliseconds are the median
over rounds, ratios are taken within a round. The benchmark stops where a contender finds something
nearer, where brute force in float64 disagrees, or where a tolerance's hits are not the nearest's.
pykdtree, open3d and nanoflann (FOLDER has nanoflann.hpp, /usr/include of Debian's libnanoflann-dev)
are optional; the line of contenders names those that run.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import importlib.util
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from legoworld.evaluation.reconstruction.nearest import Nearest, nearest_between, share_raster
from legoworld.evaluation.reconstruction.points import Raster, Tolerance, picture_raster, points_m
from legoworld.evaluation.reconstruction.protocol import bench_protocol

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from evaluation.reconstruction.brute_force import nearest as brute_force
from evaluation.reconstruction.datasets import scene

Clouds = tuple[np.ndarray, np.ndarray]
PROTOCOL = bench_protocol()
#: Of R at 2, 5 and 10 % and at 5 and 10 cm.
TOLERANCES = (PROTOCOL.headline, *PROTOCOL.others)
BOUNDED = "scipy within reach"


def surfaces(raster: Raster) -> dict[str, Clouds]:
    """Pairs of surfaces, from the same to nothing alike."""
    random = np.random.default_rng(0)
    room, _ = scene(raster, 1, 12)
    room = np.where(np.isfinite(room), room, np.float32(9))
    other, _ = scene(raster, 2, 12)
    other = np.where(np.isfinite(other), other, np.float32(9))
    made = {
        "the same": room,
        "2 % farther": room * 1.02,
        "5 % nearer": room * 0.95,
        "other objects": other,
        "half as far again": room * 1.5,
        "three times as far": room * 3,
        "a wall at 1 m": np.full_like(room, 1),
        "a wall at 20 m": np.full_like(room, 20),
        "2 % noise": room * (1 + 0.02 * random.standard_normal(room.shape)),
        "5 % noise": room * (1 + 0.05 * random.standard_normal(room.shape)),
    }
    return {name: (room, np.float32(depth)) for name, depth in made.items()}


def nanoflann(include: Path) -> Callable[[np.ndarray, np.ndarray], Clouds]:
    """nanoflann's k-d tree, compiled for this machine."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder, "tree.so")
        source = Path(__file__).with_name("nanoflann_tree.cpp")
        flags = ["-O3", "-march=native", "-std=c++17", "-shared", "-fPIC", f"-I{include}"]
        subprocess.run(["c++", *flags, str(source), "-o", str(library)], check=True)
        ask = ctypes.CDLL(str(library)).nanoflann_nearest

    def one_way(points: np.ndarray, queries: np.ndarray) -> np.ndarray:
        squared = np.empty(len(queries))
        places = [ctypes.c_void_p(array.ctypes.data) for array in (points, queries, squared)]
        ask(places[0], ctypes.c_size_t(len(points)), places[1], ctypes.c_size_t(len(queries)),
            places[2])  # fmt: skip
        return np.sqrt(squared)

    return lambda a, b: (one_way(b, a), one_way(a, b))


def contenders(include: Path | None) -> dict[str, Callable[[np.ndarray, np.ndarray], Clouds]]:
    """Nearest distances of two (N, 3) float64 clouds both ways, by name."""
    from scipy.spatial import cKDTree

    def of_scipy(a: np.ndarray, b: np.ndarray) -> Clouds:
        return cKDTree(b).query(a)[0], cKDTree(a).query(b)[0]

    relative, absolute = (
        max(getattr(t, name) for t in TOLERANCES) for name in ("relative", "absolute_m")
    )

    def bounded(a: np.ndarray, b: np.ndarray) -> Clouds:
        most = max(relative / (1 - relative) * float(max(a[:, 2].max(), b[:, 2].max())), absolute)
        return (
            cKDTree(b).query(a, distance_upper_bound=most)[0],
            cKDTree(a).query(b, distance_upper_bound=most)[0],
        )

    found = {"scipy cKDTree": of_scipy, BOUNDED: bounded}
    if importlib.util.find_spec("pykdtree"):
        from pykdtree.kdtree import KDTree

        def of_pykdtree(a: np.ndarray, b: np.ndarray) -> Clouds:
            return KDTree(b).query(a)[0], KDTree(a).query(b)[0]

        found["pykdtree"] = of_pykdtree
    if include is not None:
        found["nanoflann"] = nanoflann(include)
    with contextlib.suppress(ImportError):
        import open3d

        def cloud(points: np.ndarray) -> object:
            return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))

        def of_open3d(a: np.ndarray, b: np.ndarray) -> Clouds:
            one, other = cloud(a), cloud(b)
            return (
                np.asarray(one.compute_point_cloud_distance(other)),
                np.asarray(other.compute_point_cloud_distance(one)),
            )

        found["open3d"] = of_open3d
    return found


def check(raster: Raster, a: np.ndarray, b: np.ndarray, count: int) -> None:
    """Stops the benchmark where brute force over all pairs says otherwise."""
    label = np.zeros(a.shape, np.int32)
    some = np.full(a.shape, np.inf, np.float32)
    places = np.random.default_rng(0).choice(a.size, count, replace=False)
    some.ravel()[places] = a.ravel()[places]
    squared, index = brute_force(some, b, label, raster)
    found, _ = nearest_between(*share_raster(a, b, label, raster))
    kept = np.isfinite(some)
    same = (found.squared_m2 == squared) & (found.index == index)
    if not same[kept].all():
        sys.exit(f"wrong at {np.argwhere(kept & ~same)[:5].tolist()}")
    whole = nearest_between(*share_raster(a, b, label, raster))
    decided = nearest_between(*share_raster(a, b, label, raster), tolerances=TOLERANCES)
    for side in (0, 1):
        for one in TOLERANCES:
            if not np.array_equal(*(hits(n[side], a, side, one) for n in (whole, decided))):
                sys.exit(f"other hits at {one.name}")


def hits(found: Nearest, a: np.ndarray, side: int, tolerance: Tolerance) -> np.ndarray:
    """Points of a (side 0) or b (1) whose answer is within the tolerance at a's depth."""
    z = np.where(np.isfinite(a), a, 0).astype(np.float64)
    z = z if side == 0 else z.ravel()[np.maximum(found.index, 0)]
    return (found.index >= 0) & (np.sqrt(found.squared_m2) <= tolerance.tau_m(z))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--check", type=int, default=300)
    parser.add_argument("--raster", default="421x237")
    parser.add_argument("--nanoflann", type=Path)
    parser.add_argument("--only", default="", help="surfaces whose name has this")
    options = parser.parse_args()
    width, height = map(int, options.raster.split("x"))
    raster = picture_raster((16 * height, 9 * height), 50.0, (width, height))
    label = np.zeros((raster.height, raster.width), np.int32)
    others = contenders(options.nanoflann)
    chosen = {n: pair for n, pair in surfaces(raster).items() if options.only in n}
    print(f"{raster.width} x {raster.height} points each, both ways, CPU ms; "
          f"contenders: {', '.join(others)}")  # fmt: skip
    beaten = 0
    for name, (a, b) in chosen.items():
        check(raster, a, b, options.check)
        clouds = [points_m(depth, raster).reshape(-1, 3) for depth in (a, b)]
        times: dict[str, list[float]] = {"legoworld": [], "five tolerances": []}
        times |= {other: [] for other in others}
        for _ in range(options.rounds):
            start = time.process_time()
            nearest_between(*share_raster(a, b, label, raster), tolerances=TOLERANCES)
            times["five tolerances"].append(time.process_time() - start)
            start = time.process_time()
            ours = nearest_between(*share_raster(a, b, label, raster))
            times["legoworld"].append(time.process_time() - start)
            for other, run in others.items():
                start = time.process_time()
                theirs = run(*clouds)
                times[other].append(time.process_time() - start)
                for mine, distance in zip(ours, theirs, strict=True) if other != BOUNDED else ():
                    nearer = np.sqrt(mine.squared_m2.ravel()) > distance * (1 + 1e-5) + 1e-5
                    if nearer.any():
                        sys.exit(f"{other} finds something nearer in {name!r}")
        shown = {who: 1e3 * statistics.median(spent) for who, spent in times.items()}
        ratios = [
            min(times[o][k] for o in others if o != BOUNDED) / times["legoworld"][k]
            for k in range(options.rounds)
        ]
        near = [
            min(times[o][k] for o in others) / times["five tolerances"][k]
            for k in range(options.rounds)
        ]
        ratio = statistics.median(ratios)
        beaten += ratio >= 5
        cells = "  ".join(f"{who} {ms:.0f}" for who, ms in shown.items())
        print(f"{name:20s} {cells}  best of the others / ours {ratio:.1f}, "
              f"five tolerances {statistics.median(near):.1f}")  # fmt: skip
    print(f"at least 5 times the best of the others: {beaten} of {len(chosen)}")


if __name__ == "__main__":
    main()
