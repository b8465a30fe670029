"""Times the scoring of a bench: one case in parts, and a whole run again from its files.

    python benchmarks/bench/scoring.py [--cases 208] [--workers 2] [--rounds 3]

Makes a bench of 1920 x 1080 pictures, 421 x 237 points and 512 x 288 renders out of planes and
balls, with submissions that are off by 3 % or have other objects. R alone is what a cached
snapshot leaves to do after the kernel: reading the surface, both searches, five tolerances. The
run is scored from an empty cache of pictures, then again with and without diagnostics. Memory is
the peak of the process above its start, and the highest of any worker (Linux): a child's
`ru_maxrss` begins at its parent's and says nothing.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from legoworld.evaluation.family import EvaluationRequest
from legoworld.evaluation.reconstruction import appearance
from legoworld.evaluation.reconstruction.dataset import BenchFolders, read_dataset
from legoworld.evaluation.reconstruction.evaluate import evaluate_bench
from legoworld.evaluation.reconstruction.geometry import PointMaps, geometry_score
from legoworld.evaluation.reconstruction.points import points_m
from legoworld.evaluation.reconstruction.protocol import Choices, bench_protocol
from legoworld.evaluation.reconstruction.reference import load_reference
from legoworld.evaluation.reconstruction.submission import (
    load_render,
    load_surface,
    read_bench_run,
)
from legoworld.evaluation.run import read_run
from legoworld.workers.tasks import WorkerPool

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from evaluation.reconstruction import datasets


def make(root: Path, cases: int) -> tuple[datasets.Dataset, Path]:
    """A bench of `cases` cases at full size, and a run with a submission for each."""
    datasets.SIZE_WH, datasets.RASTER_WH, datasets.RENDER_WH = (1920, 1080), (421, 237), (512, 288)
    dataset = datasets.write_dataset(
        root / "bench", families=-(-cases // 8), tiers=("easy", "hard"), views=4
    )
    shuffled = list(dataset.cases.values())
    submissions = {}
    for place, (image_id, case) in enumerate(dataset.cases.items()):
        other = shuffled[(place + 9) % len(shuffled)] if place % 2 else case
        depth = other.depth_z_m * np.float32(1 if place % 2 else 1.03)
        render = np.roll(other.render, 3, axis=1)
        submissions[image_id] = datasets.Submission(depth_z_m=depth, render=render)
    return dataset, datasets.write_run(root / "run", dataset, submissions)


def cpu_seconds() -> float:
    """Of this process and of those that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def workers_peak_mib() -> float:
    """The largest resident memory that a child now running has had, as Linux counts it."""
    found = 0
    for path in Path("/proc").glob("[0-9]*/status"):
        try:
            lines = dict(line.split(":", 1) for line in path.read_text().splitlines())
        except OSError:  # it has ended
            continue
        if int(lines["PPid"]) == os.getpid():
            found = max(found, int(lines.get("VmHWM", "0 kB").split()[0]))
    return found / 1024


def cpu_ms(work: Callable[[], object], rounds: int) -> float:
    """Median CPU milliseconds of the process."""
    spent = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        spent.append(1e3 * (time.process_time() - start))
    return statistics.median(spent)


def one_case(private: Path, run_folder: Path, rounds: int) -> None:
    """Parts of a case's score, CPU milliseconds, median over cases."""
    dataset, run, protocol = read_dataset(private), read_bench_run(run_folder), bench_protocol()
    folders: BenchFolders = dataset.folders
    found: dict[str, list[float]] = {}
    for row in run.rows[:6]:
        case = dataset.cases[row.image_id]
        reference = load_reference(folders, case, protocol.depth_limit_m)
        surface = load_surface(run_folder, row.surface, reference.raster)
        points = PointMaps(reference=reference, surface=surface)
        picture = appearance.decode_picture(folders.reference(case).read_bytes())
        parts = {
            "reading the reference's points": lambda case=case: load_reference(
                folders, case, protocol.depth_limit_m
            ),
            "reading the submitted surface": lambda row=row, reference=reference: load_surface(
                run_folder, row.surface, reference.raster
            ),
            "both surfaces' points": lambda reference=reference, surface=surface: (
                points_m(reference.depth_z_m, reference.raster),
                points_m(surface.depth_z_m, reference.raster),
            ),
            "R, five tolerances": partial(
                geometry_score,
                folders,
                case,
                reference,
                surface,
                points,
                protocol,
                Choices(diagnostics=False),
            ),
            "R and every diagnostic": partial(
                geometry_score, folders, case, reference, surface, points, protocol, Choices()
            ),
            "decoding the reference picture": lambda case=case: appearance.decode_picture(
                folders.reference(case).read_bytes()
            ),
            "resizing it": lambda picture=picture: appearance.resize_picture(picture, (512, 288)),
            "decoding the render": lambda row=row: load_render(run_folder, row.render),
        }
        for name, work in parts.items():
            found.setdefault(name, []).append(cpu_ms(work, rounds))
    for name, values in found.items():
        print(f"  {name:34s} {statistics.median(values):7.1f} CPU ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=208)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        os.environ["LEGOWORLD_CACHE"] = str(root / "cache")  # the pictures' starts empty
        dataset, run = make(root, options.cases)
        print(f"{len(dataset.cases)} cases")
        one_case(dataset.private, run, options.rounds)
        pool = WorkerPool(engine="local", workers=options.workers)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        peaks = [0.0]
        for name, diagnostics in (
            ("once, every picture decoded, without", False),
            ("again, without", False),
            ("again, with", True),
        ):
            start, spent = time.perf_counter(), cpu_seconds()
            evaluate_bench(
                EvaluationRequest(
                    run=read_run(run),
                    truth=dataset.private,
                    output=root / "evaluation",
                    draws=10_000,
                    options={"diagnostics": diagnostics},
                    overwrite=True,
                    progress=lambda _: peaks.append(workers_peak_mib()),
                    pool=pool,
                )
            )
            print(f"the run {name} diagnostics, {options.workers} workers: "
                  f"{time.perf_counter() - start:.1f} s, CPU of all processes "
                  f"{cpu_seconds() - spent:.1f} s")  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        worker = f"the largest worker {max(peaks):.0f} MiB" if max(peaks) else "no worker was seen"
        ours = f"this process {(after - before) / 1024:.0f} MiB more than before"
        print(f"peak memory: {ours}, {worker}")


if __name__ == "__main__":
    main()
