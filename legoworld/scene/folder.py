"""Scene folders: what an agent delivers for one photo, and where it is found."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from legoworld.errors import SceneMissingError

Source = Literal["blend", "glb"]

BLEND: Final = "scene.blend"
GLB: Final = "scene.glb"
PICTURE: Final = "final.png"
PROGRAM: Final = "scene.py"
LABELS: Final = "labels.json"
FROZEN: Final = "frozen.json"
PROVENANCE: Final = "provenance.json"
EXECUTION: Final = "execution.json"
#: Where Blender looks for baked simulations of scene.blend, whether it has any or not.
SIMULATIONS: Final = "blendcache_scene"

#: The files a frozen scene consists of, besides what the .blend reads.
ARTEFACTS: Final = (BLEND, GLB, PICTURE, PROGRAM, LABELS, PROVENANCE)
#: Joints of a scene's parts, in files of any name.
URDF_SUFFIX: Final = ".urdf"
#: Those that are read as they are, so that a name that is there is judged, whatever it stands for.
JUDGED: Final = (LABELS, PROVENANCE)


@dataclass(frozen=True, kw_only=True)
class SceneFolder:
    """One scene folder. name: its path below SCENES, for messages and results."""

    path: Path
    name: str

    def file(self, name: str) -> Path:
        """The path of one of the folder's files, there or not."""
        return self.path / name

    def artefacts(self) -> tuple[str, ...]:
        """The artefacts that are there, in a fixed order; URDF files last, by name."""
        folder = str(self.path)
        return (
            *(
                name
                for name in ARTEFACTS
                if (os.path.lexists if name in JUDGED else os.path.exists)(f"{folder}/{name}")
            ),
            *self.urdf_files(),
        )

    def urdf_files(self) -> tuple[str, ...]:
        """Names of the URDF files beside the scene that can be written into a result, sorted."""
        try:
            names = [path.name for path in self.path.iterdir()]
        except OSError:
            return ()
        return tuple(sorted(n for n in names if n.endswith(URDF_SUFFIX) and n.isprintable()))


def find_scene(scenes: Path, name: str) -> SceneFolder:
    """The folder of one scene. Raises SceneMissingError when it holds nothing to read."""
    folder = SceneFolder(path=scenes / name, name=name)
    if not folder.path.is_dir():
        raise SceneMissingError(
            f"there is no scene folder {name!r}",
            found="no such folder",
            expected=f"{name}/{BLEND} below the folder of scenes",
            next_step="run the scene program with `legoworld execute`, or leave it missing",
        )
    if not folder.file(BLEND).exists() and not folder.file(GLB).exists():
        dangling = [n for n in (BLEND, GLB) if os.path.lexists(folder.file(n))]
        if dangling:
            raise SceneMissingError(
                f"the scene folder {name!r} holds no scene",
                found=f"{dangling[0]} is a link to a file that does not exist",
                expected=BLEND,
                next_step="deliver the file that the link names, or copy it into the folder",
            )
        names = sorted(p.name for p in folder.path.iterdir())[:5]
        raise SceneMissingError(
            f"the scene folder {name!r} holds no scene",
            found=", ".join(names) or "an empty folder",
            expected=BLEND,
            next_step="run the scene program with `legoworld execute`",
        )
    return folder
