"""The examples that ship with the package."""

from __future__ import annotations

from pathlib import Path

from legoworld.errors import InstallationError
from legoworld.shipped import catalog


def shipped_examples(task: str) -> tuple[Path, Path]:
    """The folder of the example scenes, and their track for a task."""
    scenes = catalog.folder("examples")
    name = "track_lvis.json" if task == "lvis" else "track_coco.json"
    track = catalog.folder("datasets") / "skimage_examples" / name
    if not scenes.is_dir() or not track.is_file():
        raise InstallationError(
            "this installation contains no examples",
            found=f"no {scenes.name} or no {name}",
            expected="the examples beside the package",
            next_step="pass a folder of scenes",
        )
    return scenes, track
