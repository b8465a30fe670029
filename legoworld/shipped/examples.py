"""The examples that ship with the package."""

from __future__ import annotations

from pathlib import Path

from legoworld.errors import InstallationError
from legoworld.shipped import catalog


def shipped_examples(dataset: str) -> tuple[Path, Path]:
    """The example scenes, and their track for a dataset, COCO's without. InstallationError."""
    scenes = catalog.folder("examples")
    tracks = catalog.folder("datasets") / "skimage_examples"
    own = f"track_{dataset}.json"
    name = own if (tracks / own).is_file() else "track_coco.json"
    track = tracks / name
    if not scenes.is_dir() or not track.is_file():
        raise InstallationError(
            "this installation contains no examples",
            found=f"no {scenes.name} or no {name}",
            expected="the examples beside the package",
            next_step="pass a folder of scenes",
        )
    return scenes, track
