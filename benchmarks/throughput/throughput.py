"""Many scenes in one readout: what legoworld adds to Blender, and how fast it is without Blender.

    python benchmarks/throughput/throughput.py [--count 200] [--low 5000] [--high 500000]

Rounds are interleaved: Blender alone (open and evaluate every scene, in as many processes as
workers, imports included), a readout without cache, a readout from the cache. Printed are the
medians of the per-round ratios and the images per second. `--low 5000 --high 5000` measures scenes
of COCO's size and simple geometry.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent


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
    seconds: dict[str, list[float]] = {"alone": [], "uncached": [], "cached": []}
    for number in range(chosen.rounds):
        readout = [
            sys.executable, "-m", "legoworld", "readout", scenes, "--task", chosen.task, "-q",
            "--workers", chosen.workers, "--overwrite",
        ]  # fmt: skip
        if not number:
            run([*readout, "-o", temporary / "warm", "--cache", cache])
        seconds["alone"].append(blender_alone(blends, chosen.workers))
        seconds["uncached"].append(run([*readout, "-o", temporary / "uncached", "--no-cache"]))
        seconds["cached"].append(run([*readout, "-o", temporary / "cached", "--cache", cache]))
    added = [u / a - 1 for a, u in zip(seconds["alone"], seconds["uncached"], strict=True)]
    print(f"{len(blends)} scenes, {chosen.task}, {chosen.workers} workers, {chosen.rounds} rounds")
    for name, values in seconds.items():
        rate = len(blends) / statistics.median(values)
        print(f"  {name:9} {statistics.median(values):7.2f} s  {rate:7.1f} images/s")
    print(f"  legoworld adds {statistics.median(added):+.1%} to Blender alone (median of rounds)")


def blender_alone(blends: list[Path], workers: int) -> float:
    """Wall seconds of `workers` processes that only open and evaluate."""
    began = time.perf_counter()
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
    return time.perf_counter() - began


def run(command: list[object]) -> float:
    """Wall seconds of a command that must succeed."""
    began = time.perf_counter()
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - began


if __name__ == "__main__":
    sys.exit(main())
