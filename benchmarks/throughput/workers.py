"""One readout with 1, 2, 4 and 8 workers: the same bytes, images per second, CPU and memory.

    python benchmarks/throughput/workers.py [--count 240] [--workers 1,2,4,8] [--rounds 1]

Simple scenes (5k triangles), so that starting, waiting and contention weigh most. Rounds are
interleaved: each number of workers reads uncached (with as many Blender processes) and from the
cache. Memory is the largest sum of resident memory over all processes of the command, pages that
they share counted for each. Exit 1 where a run's files differ from those of the first one; only
run.json's time is left out.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from scene.foreign.processes import descendants, resident

HERE = Path(__file__).parent
_SAMPLED_EVERY_S = 0.1
_TIME = re.compile(rb'"finished_at": "[^"]*"')


class Cost(NamedTuple):
    """A readout's seconds, CPU seconds of all its processes, and largest memory in MB."""

    wall_s: float
    cpu_s: float
    memory_mb: float


def main() -> int:
    """Build, run the rounds, print; see the module's docstring."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=240)
    parser.add_argument("--workers", default="1,2,4,8")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--task", default="lvis")
    parser.add_argument("--scenes", type=Path, help="use these scenes")
    chosen = parser.parse_args()
    workers = [int(text) for text in chosen.workers.split(",")]
    with tempfile.TemporaryDirectory(prefix="legoworld-workers-") as temporary:
        folder = Path(temporary)
        scenes = chosen.scenes or folder / "scenes"
        if chosen.scenes is None:
            command = [sys.executable, HERE / "build.py", scenes, chosen.count, 5000, 5000, 0]
            subprocess.run([str(c) for c in command], check=True, stdout=subprocess.DEVNULL)
        return measure(scenes, workers, chosen.rounds, chosen.task, folder)


def measure(scenes: Path, workers: list[int], rounds: int, task: str, folder: Path) -> int:
    """Interleaved rounds, their table, and whether all bytes are the same."""
    count = sum(1 for _ in scenes.glob("*/scene.blend"))
    costs: dict[tuple[str, int], list[Cost]] = {}
    bytes_of: dict[str, set[str]] = {"uncached": set(), "cached": set()}
    kinds = {"uncached": ["--no-cache"], "cached": ["--cache", str(folder / "cache")]}
    read_out(scenes, task, workers[-1], kinds["cached"], folder / "warm")
    for _ in range(rounds):
        for number in workers:
            for kind, options in kinds.items():
                run = folder / kind
                cost = read_out(scenes, task, number, options, run)
                costs.setdefault((kind, number), []).append(cost)
                bytes_of[kind].add(digest(run))
    print(f"{count} scenes, {task}, {len(os.sched_getaffinity(0))} cores, {rounds} rounds, load "
          f"{os.getloadavg()[0]:.0f}")  # fmt: skip
    print(f"{'':9} {'workers':>7} {'images/s':>9} {'CPU ms/image':>13} {'MB in all':>10}")
    for (kind, number), values in sorted(costs.items()):
        wall, cpu, memory = (statistics.median(column) for column in zip(*values, strict=True))
        print(f"{kind:9} {number:7} {count / wall:9.1f} {1000 * cpu / count:13.1f} {memory:10.0f}")
    same = len(bytes_of["uncached"] | bytes_of["cached"]) == 1
    print("every run has the same bytes" if same else "WRONG: the runs' bytes differ")
    return 0 if same else 1


def read_out(scenes: Path, task: str, workers: int, options: list[str], run: Path) -> Cost:
    """One readout that must succeed."""
    command = [
        sys.executable, "-m", "legoworld", "readout", str(scenes), "--task", task, "-q",
        "--workers", str(workers), "--overwrite", "-o", str(run), *options,
    ]  # fmt: skip
    began, before, most = time.perf_counter(), os.times(), 0
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    while process.poll() is None:
        most = max(most, sum(map(resident, [process.pid, *descendants(process.pid)])))
        time.sleep(_SAMPLED_EVERY_S)
    wall_s, after = time.perf_counter() - began, os.times()
    if process.returncode:
        raise SystemExit(f"the readout with {workers} workers ended with {process.returncode}")
    cpu_s = sum(after[2:4]) - sum(before[2:4])
    return Cost(wall_s, cpu_s, most / 1e6)


def digest(run: Path) -> str:
    """One hash over the names and bytes of a run's files."""
    whole = hashlib.sha256()
    for path in sorted(p for p in run.rglob("*") if p.is_file() and p.name != ".lock"):
        content = path.read_bytes()
        if path.name == "run.json":
            content = _TIME.sub(b"", content)
        whole.update(f"{path.relative_to(run)} {len(content)}\n".encode() + content)
    return whole.hexdigest()


if __name__ == "__main__":
    sys.exit(main())
