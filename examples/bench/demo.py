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
#: What is submitted, and its words: a good, a near and a wrong reconstruction of each case.
CHANGES = {"none": "itself", "camera": "camera 10 cm aside", "another": "another family"}


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
    changes = [c for c in CHANGES if c != "another" or len(list(references.iterdir())) > 1]
    for change in changes:
        submissions, out = top / "submissions" / change, top / "runs" / change
        run(python, HERE / "submit.py", itself, "-o", submissions, "--change", change)
        run(*legoworld, "readout", submissions, "--task", "bench",
            "--track", bench / "public" / "track.json", "-o", out)  # fmt: skip
        evaluations.append(top / "evals" / change)
        run(*legoworld, "evaluate", out, "--truth", bench / "private", "-o", evaluations[-1])
    run(*legoworld, "bench", "table", *evaluations, "-o", top / "table")
    run(*legoworld, "report", *evaluations, "-o", top / "report.html")
    print_families(top, changes)


def print_families(top: Path, changes: list[str]) -> None:
    """What each family is made of, and what its submissions score: R and A, means over its cases.

    Ends the program where a reference submitted as itself has an R other than 1.
    """
    truth = json.loads((top / "bench" / "private" / "truth.json").read_text("utf-8"))["images"]
    rows = {change: rows_of(top / "evals" / change) for change in changes}
    head = "".join(f"{CHANGES[change] + ': R, A':>28}" for change in changes)
    print(f"{'family':12} {'cases':>5}  {'objects, view by view: easy | medium | hard':44}{head}")
    for family in sorted({row["family"] for row in rows["none"]}):
        of_family = {c: [r for r in rows[c] if r["family"] == family] for c in changes}
        itself = of_family["none"]
        tiers = " | ".join(
            ", ".join(str(len(truth[str(r["image_id"])]["scored"])) for r in itself
                      if r["tier"] == tier)
            for tier in ("easy", "medium", "hard")
        )  # fmt: skip
        scores = "".join(f"{means(of_family[change]):>28}" for change in changes)
        print(f"{family:12} {len(itself):5}  {tiers:44}{scores}")
    print(f"lowest A as itself: {min(row['A'] for row in rows['none']):.4f}")
    wrong = [row["file_name"] for row in rows["none"] if row["R"] != 1]
    if wrong:
        sys.exit(f"R of a reference submitted as itself is not 1: {', '.join(wrong)}")
    print(f"R is 1 in each of {len(rows['none'])} cases submitted as themselves")


def rows_of(evaluation: Path) -> list[dict[str, Any]]:
    """An evaluation's cases."""
    lines = (evaluation / "per_image.jsonl").read_text("utf-8").splitlines()
    return [json.loads(line) for line in lines]


def means(rows: list[dict[str, Any]]) -> str:
    """R and A over cases, in words."""
    return ", ".join(f"{sum(row[score] for row in rows) / len(rows):.4f}" for score in "RA")


if __name__ == "__main__":
    main()
