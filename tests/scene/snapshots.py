"""Scene folders built by Blender, and read through it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts
from legoworld.scene.read_scene import ReadScene, read_scene

_TESTS = Path(__file__).resolve().parents[1]


def snapshot_of(
    folder: Path, blender: BlenderProcess, cache: SnapshotCache | None = None
) -> ReadScene:
    """A scene folder as every command reads it."""
    scene = SceneFolder(path=folder, name=folder.name)
    files = checked_artefacts(scene, require_frozen=False)
    return read_scene(scene, source="blend", blender=blender, cache=cache, files=files)


def read_alone(folder: Path) -> ReadScene:
    """A scene folder read in a Blender process of its own."""
    with BlenderProcess(Limits(time_s=600)) as blender:
        return snapshot_of(folder, blender)


def build(folder: Path, *modules: str, cwd: Path | None = None) -> Path:
    """The folder, made, with every scene of these modules; see cases/build.py.

    cwd: where scenes write what is no scene, the folder itself when None.
    """
    folder.mkdir()
    done = subprocess.run(
        [sys.executable, str(_TESTS / "cases" / "build.py"), str(folder), *modules],
        env={**os.environ, "PYTHONPATH": str(_TESTS)},
        cwd=cwd or folder,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return folder
