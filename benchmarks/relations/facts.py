"""CPU time of a scene's facts: python benchmarks/relations/facts.py [--objects 100] [--rounds 31].

Boxes on the floor of a room, a tenth of them stacked (tests/readouts/cubes.py), in a picture of
640 x 480. `layers`: drawing every object alone and counting who hides whom; `facts`: all that
follows from them; `questions`: the questions of the picture. Medians of the rounds, one thread.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from readouts.cubes import view_of  # pyright: ignore[reportMissingImports]

from legoworld.evaluation.relations.questions import make_questions
from legoworld.readouts.relation_facts import relation_facts
from legoworld.visibility.layers import amodal_layers, occluders


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=31)
    args = parser.parse_args()
    view, instances = view_of(*_placed(args.objects), size=(640, 480))
    facts = relation_facts(view, instances)
    given = (view.surfaces, view.projection, view.size_wh)
    layers = _cpu_ms(lambda: occluders(amodal_layers(*given, threads=1)), args.rounds)
    whole = _cpu_ms(lambda: relation_facts(view, instances, threads=1), args.rounds)
    asked = _cpu_ms(lambda: make_questions(facts, "a", 1, ["cup", "bear"]), args.rounds)
    resting = sum(gap is not None for gap in (*facts.pairs.gap_ab_m, *facts.pairs.gap_ba_m))
    print(f"{len(facts.objects)} objects, {len(facts.pairs.a)} pairs, {resting} at rest on another")
    for name, ms in (("layers", layers), ("facts", whole - layers), ("questions", asked)):
        print(f"    {name:10} {ms:8.2f} ms CPU")
    return 0


def _placed(n: int) -> list[tuple[str, tuple[float, float, float], float]]:
    random = np.random.default_rng(0)
    columns = int(np.ceil(np.sqrt(n)))
    placed = []
    for k in range(n):
        x, z = (k % columns - columns / 2) * 1.1, 6 + (k // columns) * 1.3
        side = random.uniform(0.3, 0.6)
        if k % 10 == 9:  # on the one before it
            _, (x, y, z), below = placed[-1]
            placed.append((f"kind {k % 20}", (x, y - (below + side / 2) / 2, z), side / 2))
        else:
            placed.append((f"kind {k % 20}", (x, 2 - side / 2, z), side))
    return placed


def _cpu_ms(work: Callable[[], object], rounds: int) -> float:
    times = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return statistics.median(times) * 1e3


if __name__ == "__main__":
    sys.exit(main())
