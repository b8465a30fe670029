"""The files of its own that a row of a run has, besides predictions: depth, surface and others."""

from __future__ import annotations

from pathlib import Path
from typing import Final

#: The keys of a row that describe a file (`RunRow.files`); also their folders.
FOLDERS: Final = ("depth", "normals", "surface", "render", "answer")
_SUFFIXES: Final = (".npz", ".png", ".json")


def delete_files(run: Path) -> None:
    """Delete the files of all rows."""
    for name in FOLDERS:
        folder = run / name
        for path in sorted(folder.rglob("*")) if folder.is_dir() else ():
            if path.suffix in _SUFFIXES and path.is_file():
                path.unlink()
