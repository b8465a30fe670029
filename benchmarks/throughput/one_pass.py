"""One readout of several tasks beside a readout of each: CPU seconds of all processes.

    python benchmarks/throughput/one_pass.py [--count 40] [--rounds 3] [--task coco --task lvis]

Scenes are those of throughput.py, tasks all that ship but the bench, which renders. Rounds are
interleaved, without a cache and from a warm one; printed are medians, their ratio, and each
task's own.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from pathlib import Path

from throughput import HERE, run

from legoworld.tasks.shipped import BENCH, TASKS


def main() -> int:
    """Build, run the rounds, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--task", action="append", default=[])
    chosen = parser.parse_args()
    tasks = chosen.task or [task.name for task in TASKS if task.name != BENCH]
    with tempfile.TemporaryDirectory(prefix="legoworld-one-pass-") as temporary:
        folder = Path(temporary)
        scenes, cache = folder / "scenes", folder / "cache"
        run([sys.executable, HERE / "build.py", scenes, chosen.count, 5_000, 100_000, 0])
        words = [
            sys.executable, "-m", "legoworld", "readout", scenes, "-q", "--overwrite",
            "--workers", chosen.workers, "-o", folder / "out",
        ]  # fmt: skip
        together = [word for task in tasks for word in ("--task", task)]
        run([*words, *together, "--cache", cache])
        costs: dict[tuple[str, str], list[float]] = {}
        for _ in range(chosen.rounds):
            for name, how in (("uncached", ["--no-cache"]), ("cached", ["--cache", cache])):
                one = run([*words, *together, *how]).cpu_s
                each = [
                    run([*words[:-1], folder / task, "--task", task, *how]).cpu_s for task in tasks
                ]
                costs.setdefault((name, "one pass"), []).append(one)
                costs.setdefault((name, "one by one"), []).append(sum(each))
                for task, cost in zip(tasks, each, strict=True):
                    costs.setdefault((name, task), []).append(cost)
    print(f"{chosen.count} scenes, {', '.join(tasks)}; CPU ms a scene, medians")
    for name in ("uncached", "cached"):
        one, each = (statistics.median(costs[name, how]) for how in ("one pass", "one by one"))
        scale = 1000 / chosen.count
        both = f"{scale * one:7.1f} one pass  {scale * each:7.1f} one by one"
        print(f"  {name:9} {both}  {one / each:.2f}")
        alone = (f"{t} {scale * statistics.median(costs[name, t]):.1f}" for t in tasks)
        print(f"            alone: {', '.join(alone)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
