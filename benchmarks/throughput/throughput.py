"""Many scenes in one readout: what legoworld adds to Blender, and how fast it is without Blender.

    python benchmarks/throughput/throughput.py [--count 200] [--low 5000] [--high 500000]

Rounds are interleaved: Blender alone (open and evaluate every scene, in as many processes as
workers, imports included), a readout without cache, a readout from the cache. Printed are, as
medians over the rounds, seconds, CPU seconds of all processes together (what a machine with other
load still tells), images per second and what legoworld adds. `--low 5000 --high 5000` measures
scenes of COCO's size and simple geometry.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent


class Cost(NamedTuple):
    """What a command took: seconds on the clock, and CPU seconds of all its processes."""

    wall_s: float
    cpu_s: float


def main() -> int:
    """Build, run the rounds, print; see the module's docstring."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--low", type=int, default=5_000)
    parser.add_argument("--high", type=int, default=500_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--task", default="lvis")
    parser.add_argument("--scenes", type=Path, help="Keep the built scenes here, or use them.")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="legoworld-throughput-") as temporary:
        scenes = chosen.scenes or Path(temporary) / "scenes"
        if not scenes.exists():
            build = (scenes, chosen.count, chosen.low, chosen.high, 0)
            run([sys.executable, HERE / "build.py", *build])
        blends = sorted(scenes.rglob("scene.blend"))
        measure(chosen, blends, scenes, Path(temporary))
    return 0


def measure(chosen: argparse.Namespace, blends: list[Path], scenes: Path, temporary: Path) -> None:
    """Interleaved rounds, and their table."""
    cache = temporary / "cache"
    costs: dict[str, list[Cost]] = {"alone": [], "uncached": [], "cached": []}
    for number in range(chosen.rounds):
        readout = [
            sys.executable, "-m", "legoworld", "readout", scenes, "--task", chosen.task, "-q",
            "--workers", chosen.workers, "--overwrite",
        ]  # fmt: skip
        if not number:
            run([*readout, "-o", temporary / "warm", "--cache", cache])
        costs["alone"].append(blender_alone(blends, chosen.workers))
        costs["uncached"].append(run([*readout, "-o", temporary / "uncached", "--no-cache"]))
        costs["cached"].append(run([*readout, "-o", temporary / "cached", "--cache", cache]))
    print(f"{len(blends)} scenes, {chosen.task}, {chosen.workers} workers, {chosen.rounds} rounds")
    for name, values in costs.items():
        wall, cpu = (statistics.median(column) for column in zip(*values, strict=True))
        rate = len(blends) / wall
        print(
            f"  {name:9} {wall:7.2f} s  {rate:7.1f} images/s  {cpu:7.2f} CPU s  "
            f"{1000 * cpu / len(blends):6.1f} CPU ms/image"
        )
    for name, column in (("wall", 0), ("CPU", 1)):
        pairs = zip(costs["alone"], costs["uncached"], strict=True)
        added = statistics.median(uncached[column] / alone[column] - 1 for alone, uncached in pairs)
        print(f"  legoworld adds {added:+.1%} to Blender alone in {name} time (median of rounds)")


def blender_alone(blends: list[Path], workers: int) -> Cost:
    """The cost of `workers` processes that only open and evaluate."""
    with metered() as cost:
        started = [
            subprocess.Popen(
                [sys.executable, str(HERE / "blender_alone.py"), *map(str, blends[i::workers])],
                stdout=subprocess.DEVNULL,
            )
            for i in range(workers)
        ]
        for process in started:
            if process.wait():
                raise SystemExit("blender_alone.py failed")
    return cost[0]


def run(command: list[object]) -> Cost:
    """The cost of a command that must succeed."""
    with metered() as cost:
        subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return cost[0]


@contextmanager
def metered() -> Iterator[list[Cost]]:
    """The list holds one Cost once the block has ended, of the processes that ended within it."""
    cost: list[Cost] = []
    began, before = time.perf_counter(), os.times()
    yield cost
    wall_s, after = time.perf_counter() - began, os.times()
    user_s = after.children_user - before.children_user
    system_s = after.children_system - before.children_system
    cost.append(Cost(wall_s, user_s + system_s))


if __name__ == "__main__":
    sys.exit(main())
