"""The cheats from end to end: a case, its submissions, both cards' scores of each, and the flags.

python examples/bench/cheats/run.py --kaykit FOLDER -o legoworld-cheats
python examples/bench/cheats/run.py --dataset DATASET --itself KEPT_SCENES -o legoworld-cheats
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
CASE = "kitchen__easy__view_00"
HEADLINE = ("R", "A", "S")
SECOND = ("R_p", "R_x", "A_x", "A_x_seen", "F3D", "found", "R_above_empty")


def run(*command: object, quiet: bool = False) -> None:
    """Show a step and do it; ends the program where it fails."""
    words = [str(word) for word in command]
    print("$", " ".join(words[1:]), flush=True)
    kept = subprocess.DEVNULL if quiet else None
    subprocess.run(words, check=True, stdout=kept)


def make_dataset(top: Path, kaykit: str | None, family: str) -> tuple[Path, Path]:
    """A small dataset of one family, and its references as submissions."""
    references, bench, itself = top / "references", top / "bench", top / "itself"
    given = ("--kaykit", kaykit) if kaykit else ()
    build = HERE.parent / "build.py"
    run(sys.executable, build, *given, "-o", references, "--family", family, quiet=True)
    run(sys.executable, "-m", "legoworld", "bench", "make", references, "-o", bench, "--size",
        "320x180", "--samples", 16, "--noise-seeds", 0, "--keep-scenes", itself)  # fmt: skip
    return bench, itself


def only_case(bench: Path, stem: str, output: Path) -> Path:
    """A copy of a dataset's halves with one case in them, for a quick run."""
    for half in ("public", "private"):
        (output / half).mkdir(parents=True, exist_ok=True)
        for path in (bench / half).iterdir():
            link = output / half / path.name
            if path.is_dir() and not link.exists():
                link.symlink_to(path.resolve())
    track = json.loads((bench / "public" / "track.json").read_text("utf-8"))
    track["images"] = [i for i in track["images"] if i["file_name"] == f"{stem}.png"]
    write(output / "public" / "track.json", track)
    kept = {str(image["id"]) for image in track["images"]}
    digest = sha256_of(output / "public" / "track.json")
    truth = json.loads((bench / "private" / "truth.json").read_text("utf-8"))
    truth["images"] = {k: v for k, v in truth["images"].items() if k in kept}
    write(output / "private" / "truth.json", {**truth, "track_sha256": digest})
    second = json.loads((bench / "private" / "x.json").read_text("utf-8"))
    second["images"] = [i for i in second["images"] if str(i["id"]) in kept]
    second["info"]["track_sha256"] = digest
    write(output / "private" / "x.json", second)
    return output


def write(path: Path, value: Any) -> None:
    """JSON into a file."""
    path.write_text(json.dumps(value), encoding="utf-8")


def sha256_of(path: Path) -> str:
    """A file's sha256."""
    import hashlib

    return hashlib.sha256(path.read_bytes()).hexdigest()


def scored(bench: Path, submissions: Path, out: Path) -> dict[str, Any]:
    """The row of the only case."""
    legoworld = (sys.executable, "-m", "legoworld")
    run(*legoworld, "readout", submissions, "--task", "bench-x", "--track",
        bench / "private" / "x.json", "-o", out / "run", "-q", quiet=True)  # fmt: skip
    run(*legoworld, "evaluate", out / "run", "--truth", bench / "private", "-o", out / "evaluation",
        "--draws", 10, "-q", quiet=True)  # fmt: skip
    row: dict[str, Any] = json.loads((out / "evaluation" / "per_image.jsonl").read_text("utf-8"))
    return row


def number(value: float | None) -> str:
    """.931, 1.000, -.044; a dash for none."""
    return "-" if value is None else f"{value:.3f}".replace("0.", ".", 1)


def main() -> None:
    """All steps, then the table; what is there is used again."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kaykit")
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--itself", type=Path)
    parser.add_argument("--case", default=CASE)
    parser.add_argument("-o", "--output", type=Path, required=True)
    chosen = parser.parse_args()
    top, family = chosen.output, chosen.case.partition("__")[0]
    bench, itself = chosen.dataset, chosen.itself
    if bench is None:
        bench, itself = make_dataset(top, chosen.kaykit, family)
    given = ("--itself", itself) if itself else ()
    run(sys.executable, HERE / "cheats.py", bench, "--case", chosen.case, *given, "-o",
        top / "submissions", quiet=True)  # fmt: skip
    one = only_case(bench, chosen.case, top / "one")
    rows = {
        path.name: scored(one, path, top / "scored" / path.name)
        for path in sorted((top / "submissions").iterdir())
    }
    print("| submission |", " | ".join((*HEADLINE, *SECOND)), "| flags |")
    print("|---|", "---:|" * len((*HEADLINE, *SECOND)), "---|", sep="")
    for name, row in sorted(rows.items(), key=lambda one: -one[1]["S"]):
        values = [row[k] for k in HEADLINE] + [row["x"][k] for k in SECOND]
        flags = ", ".join(sorted({flag["kind"] for flag in row["flags"]})) or "none"
        print("|", " | ".join((name.replace("-", " "), *map(number, values), flags)), "|")


if __name__ == "__main__":
    main()
