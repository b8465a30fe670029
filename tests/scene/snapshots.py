"""A scene folder read through Blender."""

from __future__ import annotations

from pathlib import Path

from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts
from legoworld.scene.reading import ReadScene, read_scene


def snapshot_of(folder: Path, blender: BlenderProcess) -> ReadScene:
    scene = SceneFolder(path=folder, name=folder.name)
    files = checked_artefacts(scene, require_frozen=False)
    return read_scene(scene, source="blend", blender=blender, cache=None, files=files)
