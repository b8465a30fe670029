"""What reading a run's predictions costs, from one file and from many, kept or passed on.

    python benchmarks/prediction_files/reading.py --images 20000 --predictions 2000000

Writes made-up masks of some 300 characters into both forms, then reads each in its own process:
`kept` holds all entries, as evaluate does; `an image at a time` holds those of one image, as merge
does; `json.loads` takes the whole text at once. Prints CPU seconds and the largest memory of each.
"""

from __future__ import annotations

import argparse
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from legoworld.records.base import canonical
from legoworld.records.folders.prediction_files import (
    prediction_files,
    predictions_of,
    stored_batches,
    write_predictions,
)
from legoworld.records.predictions import Prediction, Rle

WAYS = ("nothing", "json.loads", "kept", "an image at a time")


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
                    segmentation=Rle(size=(480, 640), counts=f"{drawn.getrandbits(1200):x}"),
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
    return sum(map(len, predictions_of(range(1, n_images + 1), files)))


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
        for way in WAYS:
            for part, more in (("one", []), ("many", ["--divided"])):
                if more and way in ("nothing", "json.loads"):
                    continue
                command = [*sys.argv, "--folder", str(Path(name, part)), "--read", way, *more]
                subprocess.run([sys.executable, *command], check=True)


if __name__ == "__main__":
    main()
