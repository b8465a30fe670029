"""Snapshots on disk, found again by the content of everything they were made from."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from legoworld import exit_codes
from legoworld.errors import LegoWorldError, cause
from legoworld.files import canonical_json, home_folder, sha256_of_text, write_text
from legoworld.scene.freeze import Hashes
from legoworld.scene.snapshot import SNAPSHOT_SCHEMA

_UNWRITABLE: Final = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOENT, errno.ENOTDIR,
                      errno.EEXIST)  # fmt: skip


class CacheFolderError(LegoWorldError):
    """The snapshot cache cannot be written."""

    code = "cache_folder"
    exit_code = exit_codes.BLOCKED


@dataclass(frozen=True)
class SnapshotCache:
    """A folder of snapshots.

    What a scene file reads besides itself is only known once it has been opened, so each entry has
    two parts: `<scene file's key>.json` lists those files, and the snapshot's own key also covers
    their content.
    """

    folder: Path

    def dependencies(self, scene_file_sha256: str, scene: Path) -> list[str] | None:
        """The files a scene file with this content reads in a folder; None: it was never opened."""
        path = self._entry(scene_file_key(scene_file_sha256), ".json")
        try:
            entry = json.loads(path.read_text(encoding="utf-8"))
            files, watched = map(str, entry["files"]), map(str, entry["watched"])
            return sorted({*files, *files_in(scene, watched)})
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def put_dependencies(
        self, scene_file_sha256: str, files: list[str], folders: list[str]
    ) -> None:
        """Remember what a scene file reads: files, and folders with whatever is in them."""
        text = canonical_json({"files": files, "watched": folders})
        write_text(self._entry(scene_file_key(scene_file_sha256), ".json"), text)

    def snapshot_path(
        self, scene_file_sha256: str, dependencies: Hashes, *, corner_normals: bool = False
    ) -> Path:
        """Where the snapshot of that scene file and those dependencies is or belongs.

        One with corner normals is a file of its own: others need not read them.
        """
        content = {
            name: None if found is None else found.sha256 for name, found in dependencies.items()
        }
        key = sha256_of_text(canonical_json([scene_file_key(scene_file_sha256), content]))
        return self._entry(key, "-normals.snapshot" if corner_normals else ".snapshot")

    def entry_path(self, content_sha256: str, suffix: str) -> Path:
        """Where what this program makes of some content is or belongs."""
        key = [content_sha256, reader_sha256(), bpy_version()]
        return self._entry(sha256_of_text(canonical_json(key)), suffix)

    @contextmanager
    def translate_write_errors(self) -> Iterator[None]:
        """A block that writes into the cache: CacheFolderError where that is not possible."""
        try:
            yield
        except OSError as error:
            if error.errno not in _UNWRITABLE:
                raise
            raise unwritable(self.folder, cause(error)) from error

    def _entry(self, key: str, suffix: str) -> Path:
        return Path(f"{self.folder}/{key[:2]}/{key[2:]}{suffix}")  # joined once, for every image


def files_in(scene: Path, folders: Iterable[str]) -> set[str]:
    """The files that are in folders now, named like these: relative to the scene, or absolute."""
    there = {name: scene / name for name in folders if (scene / name).is_dir()}
    return {
        os.path.normpath(Path(name, path.relative_to(folder)))
        for name, folder in there.items()
        for path in folder.rglob("*")
        if path.is_file()
    }


def default_cache_folder() -> Path:
    """$LEGOWORLD_CACHE, or the user's cache folder for legoworld."""
    chosen = os.environ.get("LEGOWORLD_CACHE")
    if chosen:
        return Path(chosen)
    import platformdirs

    try:
        folder = Path(platformdirs.user_cache_dir("legoworld"))
    except RuntimeError:  # no home is known
        folder = home_folder() / ".cache" / "legoworld"
    return folder / "snapshots"


def unwritable(folder: Path, why: str) -> CacheFolderError:
    """The error of a cache folder that cannot be written, as an exception to raise."""
    return CacheFolderError(
        "the snapshot cache cannot be written",
        found=f"{folder}: {why}",
        expected="a folder that this user may write into",
        next_step="choose one with --cache DIR or LEGOWORLD_CACHE, or pass --no-cache",
    )


def why_unwritable(folder: Path) -> str:
    """Create a cache folder. Returns why it cannot be written, or ""."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return cause(error)
    return "" if os.access(folder, os.W_OK | os.X_OK) else "no permission to write there"


def scene_file_key(scene_file_sha256: str) -> str:
    """The key of a scene file under this program: its content and everything that reads it."""
    return sha256_of_text(
        canonical_json([scene_file_sha256, SNAPSHOT_SCHEMA, reader_sha256(), bpy_version()])
    )


#: Modules outside `blender/` and `gltf/` that those import and a snapshot depends on.
_SHARED: Final = (
    "conventions.py",
    "files.py",
    "scene/affine.py",
    "scene/array_file.py",
    "scene/hair/ribbons.py",
    "scene/pictures.py",
    "scene/snapshot.py",
    "scene/hair/spheres.py",
    "scene/hair/strands.py",
    "scene/hair/tubes.py",
    "scene/triangle_cuts.py",
    "workers/child_process.py",
    "workers/environment.py",
    "workers/process_privacy.py",
)


def reader_sources() -> list[Path]:
    """The files of the code that makes snapshots; a test holds this against what they import."""
    package = Path(__file__).parents[1]
    folders = [package / "scene" / "blender", package / "scene" / "gltf"]
    # iterdir and not glob: this is part of every cached readout.
    readers = [p for folder in folders for p in folder.iterdir() if p.suffix == ".py"]
    return [*sorted(readers), *(package / name for name in _SHARED)]


@cache
def reader_sha256() -> str:
    """Hash of the code that makes snapshots: a changed reader never finds an old answer."""
    digest = hashlib.sha256()
    for path in reader_sources():
        content = path.read_bytes()
        digest.update(f"{path.parent.name}/{path.name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


@cache
def bpy_version() -> str:
    """The installed bpy's version, without importing it.

    Read from the name of its metadata folder: importlib.metadata takes a tenth of a cached readout.
    """
    for place in sys.path:
        for metadata in sorted(Path(place or ".").glob("bpy-*.dist-info")):
            return metadata.name.removeprefix("bpy-").removesuffix(".dist-info")
    return "not installed"
