"""The ground truth of a run's images, located before scoring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from legoworld.depth_files.read_depth import SUFFIXES, files_named, refuse_photo
from legoworld.errors import LegoWorldError
from legoworld.evaluation.pixels.predictions import photo_stem
from legoworld.pluralize import share
from legoworld.records.run_rows import RunImage

F = TypeVar("F")


def find_all_truth(
    truth: Path,
    images: Sequence[RunImage],
    find: Callable[[RunImage], F | None],
    *,
    noun: str,
    layout: str,
    error: type[LegoWorldError],
) -> tuple[F, ...]:
    """What `find` finds of every image, in image order; the error where it finds nothing.

    Nothing is scored against incomplete ground truth. layout: of a dataset, besides arrays that
    are named like the photos.
    """
    files: list[F] = []
    absent: list[RunImage] = []
    for image in images:
        file = find(image)
        if file is None:
            absent.append(image)
        else:
            files.append(file)
    if absent:
        raise error(
            f"{truth.name or truth} lacks the {noun} of "
            f"{share(len(absent), len(images), 'image', 'images')}",
            found=f"nothing for {absent[0].file_name}",
            expected=f"{layout}, or"
            f" {photo_stem(absent[0].file_name)} with one of {' '.join(SUFFIXES)}",
            next_step="point --truth at the dataset's folder, or use a track of the present images",
        )
    return tuple(files)


def find_array(
    truth: Path,
    image: RunImage,
    *,
    noun: str,
    error: type[LegoWorldError],
    stems: Callable[[str], Sequence[str]] = lambda stem: (stem,),
) -> Path | None:
    """The one array named like a photo; None without one, the error for several.

    stems: of a photo's path without extension the names, the first that there is.
    """
    names = stems(photo_stem(image.file_name))
    files = next((found for name in names if (found := files_named(truth / name))), [])
    if len(files) > 1:
        raise error(
            f"{image.file_name} has more than one ground-truth file",
            found=", ".join(p.name for p in files),
            expected=f"one {noun} file",
        )
    if not files:
        return None
    refuse_photo(files[0])
    return files[0]
