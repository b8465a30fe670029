"""Tracks of photos whose measured depth lies in a folder of files named like them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from legoworld.errors import CatalogError, UsageError
from legoworld.evaluation.depth.declaration import (
    DECLARATION,
    Declaration,
    read_declaration,
    write_declaration,
)
from legoworld.evaluation.depth.labelled import claimed_size, read_labelled
from legoworld.evaluation.depth.pictures import files_named
from legoworld.evaluation.depth.truth import planar_metres
from legoworld.pluralize import counted
from legoworld.readouts.pictures import read_photo
from legoworld.records.base import canonical
from legoworld.records.track import ImageInfo, Part
from legoworld.tracks.source import Source
from legoworld.tracks.track import scene_name

_PHOTO_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".ppm")


def declare(folder: Path, space: str | None, unit: str | None) -> str | None:
    """Write what the command says of a folder's files into its depth.toml, where none says it.

    Returns what was written, None for nothing. UsageError when the file there says something else.
    """
    if space is None and unit is None:
        return None
    there = read_declaration(folder)
    wanted = replace(there, space=space or there.space, unit=unit or there.unit)
    if wanted == there:
        return None
    if (folder / DECLARATION).exists():
        raise UsageError(
            f"{DECLARATION} says something else of {folder.name}",
            found=f"space {there.space!r}, unit {there.unit!r}",
            expected=f"space {wanted.space!r}, unit {wanted.unit!r}, as the command has it",
            next_step=f"correct {DECLARATION}, or leave --space and --unit out",
        )
    return write_declaration(folder, wanted)


def depth_folder_source(folder: Path, photos: Path, *, dataset: str | None) -> Source:
    """The photos below `photos` that have a depth file of their name below the folder.

    A photo and its depth must be of one size. Ids count from 1 in the order of the photos' paths.
    CatalogError when a file cannot be used; the first depth file of each format is read as a whole,
    of the others the header alone.
    """
    declared = read_declaration(folder)
    images: list[ImageInfo] = []
    without: list[str] = []
    read: set[str] = set()
    for name in _photos_below(photos):
        found = [p for p in files_named(folder / scene_name(name)) if not _same(p, photos / name)]
        if not found:
            without.append(name)
            continue
        if len(found) > 1:
            raise CatalogError(
                f"{name} has more than one depth file",
                found=", ".join(path.name for path in found),
                expected="one",
            )
        width, height = _size_of(
            found[0], photos / name, declared, whole=found[0].suffix not in read
        )
        read.add(found[0].suffix)
        number = len(images) + 1
        images.append(ImageInfo(id=number, file_name=name, width=width, height=height))
    if not images:
        raise CatalogError(
            f"no photo below {photos.name} has a depth below {folder.name}",
            found=f"nothing for {without[0]}" if without else "no photo",
            expected="<photo without extension>.npy, .npz, .pfm, .exr, .png, .pgm or .tiff",
        )
    left_out = counted(len(without), "photo has", "photos have")
    notice = f"{left_out} no depth file and {'is' if len(without) == 1 else 'are'} left out"
    return Source(
        name=folder.resolve().name,
        version="custom",
        sha256=hashlib.sha256(canonical(images).encode()).hexdigest(),
        images=tuple(images),
        part=Part(
            dataset=dataset or folder.resolve().name,
            dataset_images=len(images),
            photos_left_out=tuple(without),
        ),
        notices=(f"{notice}, such as {without[0]}",) if without else (),
    )


def _size_of(path: Path, photo: Path, declared: Declaration, *, whole: bool) -> tuple[int, int]:
    """A depth file's (width, height), which is the photo's, too. whole: read all of it."""
    height, width = read_photo(photo).shape[:2]
    if whole:
        planar_metres(read_labelled(path, declared), declared, path.name)
    found = claimed_size(path, declared)
    if found != (width, height):
        raise CatalogError(
            f"{path.name} is of another size than its photo",
            found=f"{found[0]}x{found[1]}",
            expected=f"{width}x{height}",
            next_step="bring the photos to the size of their depth",
        )
    return found


def _photos_below(photos: Path) -> list[str]:
    """The paths of every picture below a folder, relative to it, in their order."""
    return sorted(_pictures(photos))


def _pictures(photos: Path) -> Iterator[str]:
    for folder, below, files in os.walk(photos):
        below[:] = [name for name in below if not name.startswith(".")]
        for name in files:
            path = Path(folder) / name
            if path.suffix.lower() in _PHOTO_SUFFIXES and not name.startswith("."):
                yield path.relative_to(photos).as_posix()


def _same(a: Path, b: Path) -> bool:
    return a.resolve() == b.resolve()
