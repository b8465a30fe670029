"""Plants every fault with many seeds, and says which a first screen does not name.

    PYTHONPATH=tests python -m report.planted --seeds 20 --first 1000 --only coco

Exits 1 where a page was wrong.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
import time
from pathlib import Path

import numpy as np
from report.planted.plant import check
from report.planted.table import PLANTS


def main() -> int:
    """A line for each plant."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=1000, help="The first seed.")
    parser.add_argument("--only", default="", help="Plants whose task and name contain this.")
    options = parser.parse_args()
    wrong = 0
    for at, plant in enumerate(PLANTS):
        if options.only not in plant.id:
            continue
        said, start = [], time.process_time()
        for seed in range(options.first, options.first + options.seeds):
            with tempfile.TemporaryDirectory() as work, contextlib.redirect_stdout(io.StringIO()):
                try:
                    check(plant.make(Path(work), np.random.default_rng((seed, at))))
                except AssertionError as error:
                    said.append(f"  seed {seed}: {error}")
        spent = time.process_time() - start
        print(f"{plant.id}: {options.seeds - len(said)} of {options.seeds}, {spent:.1f} CPU s")
        print("".join(f"{line}\n" for line in said), end="", flush=True)
        wrong += len(said)
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
