"""How much the reference's sampling moves R: the table of docs/protocols/bench.md.

    python benchmarks/bench/sampling.py DATASET/private RUN... [--seeds 3]

DATASET and runs of it are what `examples/bench` and `legoworld readout` make:

    python examples/bench/build.py --kaykit KAYKIT -o references
    legoworld bench make references -o bench --size 480x270 --samples 1 --keep-scenes itself
    python examples/bench/submit.py itself -o scaled --change scale --amount 0.02
    legoworld readout scaled --task bench --track bench/public/track.json -o runs/scaled --no-render

For each run, R over its compared cases with the shipped raster, and what becomes of it with the
full-size pixel that contains each raster centre, with every full-size pixel, and with 100,000
random ones of each seed: the mean change and, in brackets, the largest of a case.
"""

from __future__ import annotations

import argparse
import statistics
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from legoworld.evaluation.reconstruction.dataset import BenchCase, BenchDataset, read_dataset
from legoworld.evaluation.reconstruction.geometry import geometry_score
from legoworld.evaluation.reconstruction.protocol import Choices, bench_protocol
from legoworld.evaluation.reconstruction.reference import load_reference
from legoworld.evaluation.reconstruction.submission import load_surface, read_bench_run
from legoworld.records.submission import BenchRow

CONTAINING = "full-size pixel of each centre"


def r_of(dataset: BenchDataset, run: Path, row: BenchRow, sampling: str) -> float:
    """R of one case under one sampling of its reference."""
    case, protocol = dataset.cases[row.image_id], bench_protocol()
    if sampling == CONTAINING:
        hashes = replace(case.truth.sha256, raster=None)
        case, sampling = BenchCase(
            image=case.image, truth=replace(case.truth, sha256=hashes)
        ), "raster"  # fmt: skip
    reference = load_reference(dataset.folders, case, protocol.depth_limit_m)
    assert row.surface, row.file_name
    surface = load_surface(run, row.surface, reference.raster)
    choices = Choices(sampling=sampling, diagnostics=False)
    return geometry_score(dataset.folders, case, reference, surface, protocol, choices).r


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("private", type=Path)
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    dataset = read_dataset(options.private.absolute())
    seeds = [f"random:{seed}" for seed in range(options.seeds)]
    for folder in options.runs:
        run = read_bench_run(folder.absolute())
        rows = [row for row in run.rows if row.status == "ok"]
        found = {
            sampling: np.array([r_of(dataset, folder.absolute(), row, sampling) for row in rows])
            for sampling in ("raster", CONTAINING, "all", *seeds)
        }
        print(f"{folder.name}: R {found['raster'].mean():.4f} over {len(rows)} cases")
        for sampling, values in found.items():
            change = values - found["raster"]
            if sampling != "raster":
                print(f"  {sampling:32s} {change.mean():+.4f} ({np.abs(change).max():.4f})")
        if len(seeds) > 1:
            spread = statistics.stdev(float(found[seed].mean()) for seed in seeds)
            print(f"  sd of the mean between seeds     {spread:.5f}")


if __name__ == "__main__":
    main()
