"""The shipped examples from scene to report: python docs/demo.py -o FOLDER.

Reads boxes and masks out of the four scenes, scores them against the hand-made truth and writes one
page. The photos come from scikit-image (`pip install '.[examples]'`) and are not part of
legoworld; no specialist was run on them.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
from pathlib import Path

import cv2
import skimage.data

from legoworld.cli import run

ROOT = Path(__file__).parents[1]
TRUTH = ROOT / "datasets" / "skimage_examples"
EXAMPLES = Path(os.path.relpath(ROOT / "examples"))


def main() -> int:
    """Each step by the command a user would type; returns 1 when one of them failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    output = parser.parse_args().output
    write_photos(output / "photos")
    failed = False
    for task in ("coco", "lvis"):
        read, scored = output / f"run-{task}", output / f"eval-{task}"
        truth = Path(os.path.relpath(TRUTH / f"truth_{task}.json"))
        failed |= step("readout", "--task", task, "-o", read) != 0
        arguments = ("--truth", truth, "-o", scored, "--overwrite")
        failed |= step("evaluate", read, *arguments, hide=True) != 0
        print_headline(scored)
    evaluations = (output / "eval-coco", output / "eval-lvis")
    page = output / "report.html"
    beside = ("--photos", output / "photos", "--scenes", EXAMPLES)
    failed |= step("report", *evaluations, *beside, "-o", page) != 0
    return int(failed)


def write_photos(folder: Path) -> None:
    """The photos that the examples rebuild, under the names the tracks use."""
    folder.mkdir(parents=True, exist_ok=True)
    photos = {name: getattr(skimage.data, name)() for name in ("astronaut", "chelsea", "coffee")}
    photos["motorcycle"] = skimage.data.stereo_motorcycle()[0]
    for name, rgb in photos.items():
        cv2.imwrite(str(folder / f"{name}.png"), rgb[:, :, ::-1])


def print_headline(evaluation: Path) -> None:
    """AP with what it was counted over; the page has the rest."""
    summary = json.loads((evaluation / "summary.json").read_text(encoding="utf-8"))
    interval, counts = summary["intervals"]["AP"], summary["counts"]
    print(
        f"AP {summary['metrics']['AP']:.3f} [{interval['low']:.3f}, {interval['high']:.3f}] over "
        f"{summary['coverage']['attempted']} images, {counts['categories_with_truth']} categories, "
        f"{counts['truth_instances']} annotations; {summary['evaluator']['name']} "
        f"{summary['evaluator']['version']}\n"
    )


def step(*arguments: object, hide: bool = False) -> int:
    """Run one command, with the line a user would type above what it prints."""
    line = [str(argument) for argument in arguments]
    print("$ legoworld " + " ".join(line), flush=True)
    with contextlib.redirect_stdout(io.StringIO()) if hide else contextlib.nullcontext():
        return run([*line, "-q"])


if __name__ == "__main__":
    raise SystemExit(main())
