"""Tracks of photos whose ground truth is a folder of arrays with the same names."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.depth_files.read_depth import files_named
from legoworld.errors import CatalogError
from legoworld.pluralize import plural
from legoworld.readouts.pictures import read_photo
from legoworld.records.base import canonical
from legoworld.records.track import ImageInfo, Part
from legoworld.tracks.track import Source, scene_name

_PHOTO_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".ppm")


@dataclass(frozen=True, kw_only=True)
class Arrays:
    """The arrays of a family.

    noun: what one holds; read: one in full, which raises for an unusable one; size_wh: its (width,
    height) by its header; find: the files of a photo, by its path below the photos; without it they
    are named as one of `stems`, of a photo's path without extension the first that there is.
    """

    noun: str
    read: Callable[[Path], object]
    size_wh: Callable[[Path], tuple[int, int]]
    find: Callable[[str], list[Path]] | None = None
    stems: Callable[[str], Sequence[str]] = lambda stem: (stem,)


def pixel_folder_source(
    folder: Path, photos: Path, *, dataset: str | None, arrays: Arrays
) -> Source:
    """The photos below `photos` that have an array of the same name below the folder.

    A photo and its array must have the same size. Ids count from 1 in the order of the photos'
    paths. Raises CatalogError for an unusable file; the first file of each format is read
    completely, of the others only the header.
    """
    noun = arrays.noun
    images: list[ImageInfo] = []
    without: list[str] = []
    read: set[str] = set()
    taken: set[Path] = set()
    for name in sorted(_pictures(photos)):
        stems = arrays.stems(scene_name(name))
        named = [arrays.find(name)] if arrays.find else (files_named(folder / s) for s in stems)
        files = _first(named, but=photos / name)
        if not files:
            without.append(name)
            continue
        if len(files) > 1:
            raise CatalogError(
                f"{name} has more than one {noun} file",
                found=", ".join(path.name for path in files),
                expected="one",
            )
        whole = files[0].suffix not in read
        width, height = _read_size(files[0], photos / name, arrays, whole=whole)
        read.add(files[0].suffix)
        taken.add(files[0].resolve())
        number = len(images) + 1
        images.append(ImageInfo(id=number, file_name=name, width=width, height=height))
    without = [name for name in without if (photos / name).resolve() not in taken]
    if not images:
        raise CatalogError(
            f"no photo below {photos.name} has a {noun} file below {folder.name}",
            found=f"nothing for {without[0]}" if without else "no photo",
            expected="<photo without extension>.npy, .npz, .pfm, .exr, .png, .pgm or .tiff",
        )
    left_out = plural(len(without), "photo has", "photos have")
    notice = f"{left_out} no {noun} file and {'is' if len(without) == 1 else 'are'} left out"
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


def _read_size(path: Path, photo: Path, arrays: Arrays, *, whole: bool) -> tuple[int, int]:
    """A file's (width, height), equal to the photo's. whole: read the whole file."""
    height, width = read_photo(photo).shape[:2]
    if whole:
        arrays.read(path)
    size_wh = arrays.size_wh(path)
    if size_wh != (width, height):
        raise CatalogError(
            f"{path.name} and its photo have different sizes",
            found=f"{size_wh[0]}x{size_wh[1]}",
            expected=f"{width}x{height}",
            next_step=f"resize the photos to the size of their {arrays.noun}",
        )
    return size_wh


def _pictures(photos: Path) -> Iterator[str]:
    """The paths of all pictures below a folder, relative to it."""
    for folder, below, files in os.walk(photos):
        below[:] = [name for name in below if not name.startswith(".")]
        for name in files:
            path = Path(folder) / name
            if path.suffix.lower() in _PHOTO_SUFFIXES and not name.startswith("."):
                yield path.relative_to(photos).as_posix()


def _first(named: Iterable[list[Path]], *, but: Path) -> list[Path]:
    """The arrays of a photo by the first of its names; a photo is not its own array."""
    for files in named:
        found = [path for path in files if path.resolve() != but.resolve()]
        if found:
            return found
    return []
