"""Names on record for files that a scene reads from outside of SCENES.

Their paths say where things lie on one machine, and who works there: a record shows the file's own
name and a hash of the path, so that the same path of the same .blend is known again anywhere.
"""

from __future__ import annotations

from pathlib import PurePath, PurePosixPath, PureWindowsPath
from typing import Final

from legoworld.files import sha256_of_text
from legoworld.scene.folder import SceneFolder

#: No relative path begins like this: a folder's name is not empty.
OUTSIDE: Final = "outside://"


def leaves_scenes(name: str, scene: SceneFolder) -> bool:
    """Whether a dependency, relative to the scene folder or absolute, lies outside of SCENES."""
    if name.startswith((OUTSIDE, "/")) or PureWindowsPath(name).drive:
        return True
    upwards = sum(part == ".." for part in PurePath(name).parts)
    depth = len(PurePosixPath(scene.name).parts) - (scene.lone is not None)
    return upwards > max(depth, 0)


def recorded_name(name: str, scene: SceneFolder) -> str:
    """What records call a dependency: its relative path, or what says no path."""
    if name.startswith(OUTSIDE) or not leaves_scenes(name, scene):
        return name
    return outside_name(name)


def outside_name(name: str) -> str:
    """A path's hash and the file's own name."""
    return f"{OUTSIDE}{sha256_of_text(ascii(name))[:16]}/{PureWindowsPath(name).name}"
