"""The files of a scene folder, where a scene is found, and names of files outside of it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath
from typing import Final, Literal

from legoworld.errors import SceneMissingError
from legoworld.files import sha256_of_text

Source = Literal["blend", "glb"]

BLEND: Final = "scene.blend"
GLB: Final = "scene.glb"
PICTURE: Final = "final.png"
PROGRAM: Final = "scene.py"
LABELS: Final = "labels.json"
FROZEN: Final = "frozen.json"
PROVENANCE: Final = "provenance.json"
EXECUTION: Final = "execution.json"
#: The files a frozen scene consists of, besides what the .blend reads.
ARTEFACTS: Final = (BLEND, GLB, PICTURE, PROGRAM, LABELS, PROVENANCE)
#: Joints of a scene's parts, in files of any name.
URDF_SUFFIX: Final = ".urdf"
#: Those that are read as they are, so that a name that is there is judged, whatever it stands for.
JUDGED: Final = (LABELS, PROVENANCE)
#: No relative path begins like this: a folder's name is not empty.
OUTSIDE: Final = "outside://"


@dataclass(frozen=True, kw_only=True)
class SceneFolder:
    """One scene folder. name: its path below SCENES, for messages and results.

    lone: the name of a .blend or .glb that is a scene by itself: it stands for scene.blend or
    scene.glb of a folder without any side file, whatever lies beside it.
    """

    path: Path
    name: str
    lone: str | None = None

    def file(self, name: str) -> Path:
        """The path of one of the folder's files, there or not."""
        return self.path / self.name_on_disk(name)

    def name_on_disk(self, name: str) -> str:
        """The name that scene.blend or scene.glb has on disk."""
        return self.lone if self.lone is not None and name == self._stands_for() else name

    def _stands_for(self) -> str:
        return GLB if Path(self.lone or "").suffix.lower() == ".glb" else BLEND

    @property
    def simulations(self) -> str:
        """Where Blender looks for baked simulations of the .blend, whether it has any or not."""
        return f"blendcache_{Path(self.name_on_disk(BLEND)).stem}"

    def artefacts(self) -> tuple[str, ...]:
        """The artefacts that are there, in a fixed order; URDF files last, by name."""
        if self.lone is not None:
            return (self._stands_for(),)
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
    """The scene of a name: a folder, or any .blend or .glb; "." is SCENES itself.

    scene.blend and scene.glb stand for their folder. Raises SceneMissingError when there is nothing
    to read.
    """
    path = scenes / name
    if is_scene_file(path) and path.name not in (BLEND, GLB):
        return SceneFolder(path=path.parent, name=name, lone=path.name)
    if is_scene_file(path):
        path, name = path.parent, PurePosixPath(name).parent.as_posix()
    folder = SceneFolder(path=path, name=name)
    if not folder.path.is_dir():
        raise SceneMissingError(
            f"there is no scene folder {name!r}",
            found="a file, and no .blend or .glb" if path.is_file() else "no such folder",
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


def is_scene_file(path: Path) -> bool:
    """Whether a path is a file that is a scene by itself."""
    return path.suffix.lower() in (".blend", ".glb") and path.is_file()


def scene_at(path: Path, source: Source) -> tuple[SceneFolder, Source]:
    """The scene of a path, and the source to read, `file_source`. Raises SceneMissingError.

    path: a scene folder, or any .blend or .glb, as `find_scene` takes it.
    """
    whole = path.resolve()
    own = file_source(whole, source)
    if is_scene_file(whole) and whole.name in (BLEND, GLB):
        whole = whole.parent
    return find_scene(whole.parent, whole.name), own


def file_source(path: Path, source: Source) -> Source:
    """The source of a scene file, which is its own; of a folder the one that is given."""
    if not is_scene_file(path):
        return source
    return "glb" if path.suffix.lower() == ".glb" else "blend"


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
