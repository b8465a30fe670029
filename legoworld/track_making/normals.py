"""Tracks from folders of measured normals."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from legoworld.errors import UsageError
from legoworld.evaluation.normals.arrays import (
    DECLARATION,
    file_stems,
    read_declaration,
    read_normals,
)
from legoworld.evaluation.pixels.labelled import claimed_size, declare
from legoworld.track_making.family import TrackFamily
from legoworld.track_making.pixel_folders import Arrays, pixel_folder_source
from legoworld.tracks.track import Source


def normals_source(task: str, folder: Path, options: Mapping[str, Any]) -> Source:
    """The public half of a folder of normals that are named like the photos. UsageError."""
    photos = options.get("photos")
    if not folder.is_dir() or photos is None:
        raise UsageError(
            f"the ground truth of {task} is a folder of arrays named like the photos",
            found=folder.name + (" without --photos" if photos is None else ""),
            expected="--truth FOLDER --photos PHOTOS",
        )
    declared = read_declaration(folder)
    arrays = Arrays(
        noun="normals",
        read=lambda path: read_normals(path, declared),
        size_wh=lambda path: claimed_size(
            path, lambda file, stop: read_normals(file, declared, stop)
        ),
        stems=file_stems,
    )
    return pixel_folder_source(folder, photos, dataset=options.get("dataset"), arrays=arrays)


def _declare(folder: Path, given: Mapping[str, str | None]) -> tuple[str, str] | None:
    text = declare(folder / DECLARATION, vars(read_declaration(folder)), given)
    return (DECLARATION, text) if text else None


TRACK: Final = TrackFamily(
    source=normals_source,
    options=frozenset({"dataset", "photos", "sign"}),
    declared=frozenset({"sign"}),
    declare=_declare,
)
