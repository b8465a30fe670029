"""Tracks from folders of measured depth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from legoworld.errors import UsageError
from legoworld.evaluation.depth.arrays import DECLARATION, read_declaration
from legoworld.evaluation.depth.labelled import UNITS, is_unit, read_labelled
from legoworld.evaluation.depth.truth import planar_metres
from legoworld.evaluation.pixels.labelled import claimed_size, declare
from legoworld.track_making.eth3d import eth3d_source
from legoworld.track_making.family import TrackFamily
from legoworld.track_making.pixel_folders import Arrays, pixel_folder_source
from legoworld.tracks.track import Source


def depth_source(_task: str, folder: Path, options: Mapping[str, Any]) -> Source:
    """The public half of a folder of measured depth: ETH3D's layout, or files named like photos.

    options: scenes, those to take in ETH3D's layout; dataset, the name of one other than ETH3D;
    photos, the photos of a folder of depth files. UsageError for a file, and for scenes with
    photos.
    """
    scenes, dataset, photos = (options.get(name) for name in ("scenes", "dataset", "photos"))
    if not folder.is_dir():
        raise UsageError(
            "the ground truth of depth is a folder",
            found=folder.name,
            expected="a folder of depth files",
        )
    if photos is None:
        return eth3d_source(folder, scenes=scenes, dataset=dataset)
    if scenes is not None:
        raise UsageError(
            "--scenes and --photos cannot be combined",
            found="both",
            expected="--scenes for ETH3D's layout, --photos for depth files named like the photos",
        )
    declared = read_declaration(folder)
    arrays = Arrays(
        noun="depth",
        read=lambda path: planar_metres(read_labelled(path, declared), declared, path.name),
        size_wh=lambda path: claimed_size(
            path, lambda file, stop: read_labelled(file, declared, check_size=stop)
        ),
    )
    return pixel_folder_source(folder, photos, dataset=dataset, arrays=arrays)


def _declare(folder: Path, given: Mapping[str, str | None]) -> tuple[str, str] | None:
    unit = given["unit"]
    if unit is not None and not is_unit(unit) and unit != "px":
        raise UsageError(f"--unit {unit!r} is not one of {UNITS}")
    text = declare(folder / DECLARATION, vars(read_declaration(folder)), given)
    return (DECLARATION, text) if text else None


TRACK: Final = TrackFamily(
    source=depth_source,
    options=frozenset({"scenes", "dataset", "photos", "space", "unit"}),
    declared=frozenset({"space", "unit"}),
    declare=_declare,
)
