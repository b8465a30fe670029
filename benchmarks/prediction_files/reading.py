"""What reading a run's predictions costs, from one file and from many, kept or passed on.

    python benchmarks/prediction_files/reading.py --images 20000 --predictions 2000000
    python benchmarks/prediction_files/reading.py --before ../before --rounds 3

Writes made-up masks of some 300 characters into both forms, then reads each in its own process:
`columns` is what evaluate does; `kept` holds all entries; `an image at a time` holds those of one
image, as merge does; `json.loads` takes the whole text at once. Prints CPU seconds and the largest
memory of each. With --before another checkout reads the same files by its own version of this
script, one after the other in every round; a way that it does not have is this one's alone.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from legoworld.evaluation.detection.inputs.prediction_columns import mask_columns
from legoworld.records.base import canonical
from legoworld.records.folders.prediction_files import (
    prediction_files,
    read_image_predictions,
    stored_batches,
    write_predictions,
)
from legoworld.records.predictions import MaskPrediction, Prediction, Rle

WAYS = ("nothing", "json.loads", "kept", "an image at a time", "columns")
ROOT = Path(__file__).resolve().parents[2]
SIZE_WH = (640, 480)


def made_up(n_images: int, n_predictions: int) -> Iterator[list[str]]:
    """Masks by image as JSON, the same every time."""
    drawn = random.Random(0)
    for image in range(1, n_images + 1):
        n = n_predictions * image // n_images - n_predictions * (image - 1) // n_images
        yield [
            canonical(
                Prediction(
                    image_id=image,
                    category_id=drawn.randrange(1, 1204),
                    segmentation=Rle(size=SIZE_WH[::-1], counts=f"{drawn.getrandbits(1200):x}"),
                    score=round(drawn.random(), 4),
                )
            )
            for _ in range(n)
        ]


def read(way: str, files: list[Path], n_images: int) -> int:
    """How many entries there are, read in one of the ways."""
    if way == "json.loads":
        import json

        return len([e for f in files for e in json.loads(f.read_text(encoding="utf-8"))])
    if way == "kept":
        return len([*chain.from_iterable(stored_batches(files, Prediction))])
    if way == "nothing":
        return 0
    if way == "columns":
        sizes_wh = dict.fromkeys(range(1, n_images + 1), SIZE_WH)
        return len(mask_columns(stored_batches(files, MaskPrediction), sizes_wh).columns)
    return sum(map(len, read_image_predictions(range(1, n_images + 1), files)))


def measured(way: str, folder: Path, per_file: int | None, n_images: int) -> None:
    """Read in this process and print what it took."""
    files = prediction_files(folder, per_file, n_images)
    start = time.process_time()
    count = read(way, files, n_images)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
    form = "one file" if per_file is None else f"{len(files)} files"
    print(
        f"{way:<20} {form:<10} {count:>9} entries {time.process_time() - start:8.2f} CPU s "
        f"{peak:8.0f} MiB",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--images", type=int, default=20_000)
    parser.add_argument("--predictions", type=int, default=2_000_000)
    parser.add_argument("--images-per-file", type=int, default=1000)
    parser.add_argument("--before", type=Path, help="another checkout")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--read", choices=WAYS, help=argparse.SUPPRESS)
    parser.add_argument("--divided", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.read:
        per_file = options.images_per_file if options.divided else None
        measured(options.read, options.folder, per_file, options.images)
        return
    with tempfile.TemporaryDirectory() as name:
        for part, per_file in (("one", None), ("many", options.images_per_file)):
            start = time.process_time()
            folder = Path(name, part)
            images = made_up(options.images, options.predictions)
            write_predictions(folder, per_file, images, options.images)
            files = prediction_files(folder, per_file, options.images)
            size = sum(f.stat().st_size for f in files)
            print(f"written: {size / 1e6:.0f} MB, {time.process_time() - start:.1f} CPU s")
        for number in range(options.rounds):
            print(f"round {number + 1}", flush=True)
            for way in WAYS:
                for part, more in (("one", []), ("many", ["--divided"])):
                    if not (more and way in ("nothing", "json.loads")):
                        read_by_each(options.before, way, [*more, "--folder", f"{name}/{part}"])


def read_by_each(before: Path | None, way: str, more: list[str]) -> None:
    """Read in one way by a process of the other checkout, if any, and by one of this."""
    for name, root in (("before", before), ("here", ROOT)):
        if root is None or (root == before and way == "columns"):
            continue
        script = root.resolve() / Path(__file__).relative_to(ROOT)
        command = [sys.executable, str(script), *of_both(sys.argv[1:]), "--read", way, *more]
        print(f"{name:<7}", end="", flush=True)
        subprocess.run(command, env={**os.environ, "PYTHONPATH": str(root.resolve())}, check=True)


def of_both(arguments: list[str]) -> list[str]:
    """The arguments that the script of another checkout has, too."""
    pairs = zip(arguments[::2], arguments[1::2], strict=True)
    return [word for pair in pairs if pair[0] not in ("--before", "--rounds") for word in pair]


if __name__ == "__main__":
    main()
