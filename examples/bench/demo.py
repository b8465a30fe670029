"""The bench from end to end: families, dataset, submissions, readout, evaluation, table, report.

python examples/bench/demo.py --kaykit FOLDER -o legoworld-bench [--family kitchen]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from kaykit import assets_folder

HERE = Path(__file__).parent
#: Small pictures: the demo renders each of them on the CPU.
SIZE, SAMPLES = "480x270", "16"


def run(*command: object) -> None:
    """Show a step and do it; ends the program where it fails."""
    words = [str(word) for word in command]
    print("$", " ".join(words[1:]), flush=True)
    subprocess.run(words, check=True)


def main() -> None:
    """All steps; the output folder must be empty."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kaykit")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--family", action="append", default=[])
    chosen = parser.parse_args()
    top, python = chosen.output, sys.executable
    legoworld = (python, "-m", "legoworld")
    families = [word for name in chosen.family for word in ("--family", name)]
    kaykit = assets_folder(chosen.kaykit)
    references, bench, itself = top / "references", top / "bench", top / "itself"
    run(python, HERE / "build.py", "--kaykit", kaykit, "-o", references, *families)
    run(*legoworld, "bench", "make", references, "-o", bench, "--size", SIZE, "--samples", SAMPLES,
        "--noise-seeds", 0, "--keep-scenes", itself)  # fmt: skip
    evaluations = []
    for change in ("none", "scale"):
        submissions, out = top / "submissions" / change, top / "runs" / change
        run(python, HERE / "submit.py", itself, "-o", submissions, "--change", change)
        run(*legoworld, "readout", submissions, "--task", "bench",
            "--track", bench / "public" / "track.json", "-o", out)  # fmt: skip
        evaluations.append(top / "evals" / change)
        run(*legoworld, "evaluate", out, "--truth", bench / "private", "-o", evaluations[-1])
    run(*legoworld, "bench", "table", *evaluations, "-o", top / "table")
    run(*legoworld, "report", *evaluations, "-o", top / "report.html")


if __name__ == "__main__":
    main()
