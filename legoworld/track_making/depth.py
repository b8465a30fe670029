"""Tracks from folders of measured depth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from legoworld.errors import UsageError
from legoworld.track_making.depth_folders import depth_folder_source
from legoworld.track_making.eth3d import eth3d_source
from legoworld.track_making.family import TrackFamily
from legoworld.tracks.source import Source


def depth_source(_task: str, folder: Path, options: Mapping[str, Any]) -> Source:
    """The public half of a folder of measured depth: ETH3D's layout, or files named like photos.

    options: scenes, those to take in ETH3D's layout; dataset, the name of one other than ETH3D;
    photos, the photos of a folder of depth files.
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
    return depth_folder_source(folder, photos, dataset=dataset)


TRACK: Final = TrackFamily(
    source=depth_source, options=frozenset({"scenes", "dataset", "photos", "space", "unit"})
)
