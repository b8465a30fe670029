"""The bench from end to end: families, dataset, submissions, readout, evaluation, table, report.

python examples/bench/demo.py --kaykit FOLDER -o legoworld-bench [--family kitchen]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from kaykit import assets_folder

HERE = Path(__file__).parent
#: Small pictures, for the demo renders each of them on the CPU; the render card's are 512 wide.
SIZE, SAMPLES = "640x360", "16"
CHANGES = ("none", "scale")


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
    for change in CHANGES:
        submissions, out = top / "submissions" / change, top / "runs" / change
        run(python, HERE / "submit.py", itself, "-o", submissions, "--change", change)
        run(*legoworld, "readout", submissions, "--task", "bench",
            "--track", bench / "public" / "track.json", "-o", out)  # fmt: skip
        evaluations.append(top / "evals" / change)
        run(*legoworld, "evaluate", out, "--truth", bench / "private", "-o", evaluations[-1])
    run(*legoworld, "bench", "table", *evaluations, "-o", top / "table")
    run(*legoworld, "report", *evaluations, "-o", top / "report.html")
    print_families(top)


def print_families(top: Path) -> None:
    """What each family is made of, and what it scores as itself and 2 % too large.

    Ends the program where a reference submitted as itself has an R other than 1.
    """
    truth = json.loads((top / "bench" / "private" / "truth.json").read_text("utf-8"))["images"]
    rows = {change: rows_of(top / "evals" / change) for change in CHANGES}
    print(f"{'family':12} {'cases':>5}  {'objects, view by view: easy | medium | hard':44}"
          "  itself: R, A mean (least)   2 % too large: R, A")  # fmt: skip
    for family in sorted({row["family"] for row in rows["none"]}):
        itself, larger = ([r for r in rows[c] if r["family"] == family] for c in CHANGES)
        tiers = " | ".join(
            ", ".join(str(len(truth[str(r["image_id"])]["scored"])) for r in itself
                      if r["tier"] == tier)
            for tier in ("easy", "medium", "hard")
        )  # fmt: skip
        print(f"{family:12} {len(itself):5}  {tiers:44}  {mean(itself, 'R'):.4f}, "
              f"{mean(itself, 'A'):.4f} ({min(r['A'] for r in itself):.4f})"
              f"   {mean(larger, 'R'):.4f}, {mean(larger, 'A'):.4f}")  # fmt: skip
    wrong = [row["file_name"] for row in rows["none"] if row["R"] != 1]
    if wrong:
        sys.exit(f"R of a reference submitted as itself is not 1: {', '.join(wrong)}")
    print(f"R is 1 in each of {len(rows['none'])} cases submitted as themselves")


def rows_of(evaluation: Path) -> list[dict[str, Any]]:
    """An evaluation's cases."""
    lines = (evaluation / "per_image.jsonl").read_text("utf-8").splitlines()
    return [json.loads(line) for line in lines]


def mean(rows: list[dict[str, Any]], score: str) -> float:
    """Of a score over cases."""
    return sum(row[score] for row in rows) / len(rows)


if __name__ == "__main__":
    main()
