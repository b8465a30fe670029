"""A scene folder to its snapshot: checked, hashed, and opened only when it must be."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from legoworld.errors import SceneInvalidError
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import BLEND, GLB, SceneFolder, Source
from legoworld.scene.freeze import (
    FileHash,
    FrozenFiles,
    checked_artefacts,
    hash_files,
    hashed_dependencies,
    is_still,
)
from legoworld.scene.side_files import SideFile, read_side_file
from legoworld.scene.snapshot import Snapshot, load, save

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class ReadScene:
    """A snapshot, its content hash, and the files it was made from."""

    snapshot: Snapshot
    snapshot_sha256: str
    files: FrozenFiles


def read_scene(
    scene: SceneFolder,
    *,
    source: Source,
    blender: BlenderProcess,
    cache: SnapshotCache | None,
    files: FrozenFiles,
) -> ReadScene:
    """The snapshot of a scene whose files were hashed by `checked_artefacts`.

    Raises the typed verdicts of `errors`: missing, invalid, changed, failed or timeout.
    """
    if source == "glb":
        return _read_glb(scene, cache, files)
    blend = files.artefacts.get(BLEND)
    if blend is None:
        raise SceneInvalidError(
            "the scene folder holds no scene.blend",
            found=", ".join(files.artefacts) or "nothing",
            expected=BLEND,
            next_step="pass --source glb to `legoworld readout` or `inspect` to read scene.glb"
            if GLB in files.artefacts
            else "run the scene program with `legoworld execute`",
        )
    names = cache.dependencies(blend.sha256, scene.path) if cache else None
    if cache is not None and names is not None:
        known = hashed_dependencies(scene, names, files, read_by=BLEND)
        stored = _stored(cache.snapshot_path(blend.sha256, known.dependencies))
        if stored is not None:
            return ReadScene(snapshot=stored[0], snapshot_sha256=stored[1], files=known)
    return _read_with_blender(scene, blend, cache, blender, files)


def _stored(path: Path) -> tuple[Snapshot, str] | None:
    """A cached snapshot and its content hash; None where there is none that can be read.

    A damaged entry is made again, like one that is not there.
    """
    try:
        return load(path)
    except SceneInvalidError:
        return None


def _read_with_blender(
    scene: SceneFolder,
    blend: FileHash,
    cache: SnapshotCache | None,
    blender: BlenderProcess,
    files: FrozenFiles,
) -> ReadScene:
    if cache is None:  # each snapshot takes the place of the one before
        output = blender.workspace("legoworld-snapshot-") / "made.snapshot"
        known, _, _ = _made(scene, blend, blender, files, output, passing=True)
        snapshot, content = load(output, passing=True)
        return ReadScene(snapshot=snapshot, snapshot_sha256=content, files=known)
    cache.folder.mkdir(parents=True, exist_ok=True)
    output = blender.workspace(".reading-", cache.folder) / "made.snapshot"
    known, names, watched = _made(scene, blend, blender, files, output, passing=False)
    stored = cache.snapshot_path(blend.sha256, known.dependencies)
    stored.parent.mkdir(parents=True, exist_ok=True)
    output.replace(stored)
    cache.put_dependencies(blend.sha256, names, watched)
    snapshot, content = load(stored)
    return ReadScene(snapshot=snapshot, snapshot_sha256=content, files=known)


def _made(
    scene: SceneFolder,
    blend: FileHash,
    blender: BlenderProcess,
    files: FrozenFiles,
    output: Path,
    *,
    passing: bool,
) -> tuple[FrozenFiles, list[str], list[str]]:
    """Have Blender write the snapshot.

    Returns the files it was made from, their names, and the folders that more may appear in.
    """
    answer = blender.request(
        {
            "kind": "snapshot",
            # The folder is resolved and the file is not: what it links lies beside the name.
            "blend": str(scene.path.resolve() / BLEND),
            "output": str(output),
            "passing": passing,
        }
    )
    known = hashed_dependencies(scene, answer["dependencies"], files, read_by=BLEND)
    # The file may have been replaced meanwhile: what was hashed must be what was read.
    if not is_still(scene.path, BLEND, blend):
        raise _changed(scene, BLEND)
    return known, answer["dependencies"], answer["watched"]


def _read_glb(scene: SceneFolder, cache: SnapshotCache | None, files: FrozenFiles) -> ReadScene:
    """The snapshot of scene.glb: from the cache, or read here without Blender."""
    from legoworld.scene.gltf.buffers import external_files
    from legoworld.scene.gltf.container import parse_glb
    from legoworld.scene.gltf.snapshot import snapshot_of_glb

    glb = files.artefacts.get(GLB)
    if glb is None:
        raise SceneInvalidError(
            "the scene folder holds no scene.glb",
            found=", ".join(files.artefacts) or "nothing",
            expected=GLB,
            next_step="export scene.glb, or use --source blend",
        )
    names = cache.dependencies(glb.sha256, scene.path) if cache else None
    if cache is not None and names is not None:
        known = hashed_dependencies(scene, names, files, read_by=GLB)
        stored = _stored(cache.snapshot_path(glb.sha256, known.dependencies))
        if stored is not None:
            return ReadScene(snapshot=stored[0], snapshot_sha256=stored[1], files=known)
    data = scene.file(GLB).read_bytes()
    if hashlib.sha256(data).hexdigest() != glb.sha256:
        raise _changed(scene, GLB)
    parsed = parse_glb(data)
    names = external_files(parsed.document, scene.path)
    known = hashed_dependencies(scene, names, files, read_by=GLB)
    snapshot = snapshot_of_glb(parsed, scene.path)
    # A file beside it may have been replaced meanwhile: what was hashed must be what was read.
    if hash_files(scene.path, names) != known.dependencies:
        raise _changed(scene, GLB)
    if cache is None:
        return ReadScene(snapshot=snapshot, snapshot_sha256=snapshot.content_sha256(), files=known)
    content = save(snapshot, cache.snapshot_path(glb.sha256, known.dependencies))
    cache.put_dependencies(glb.sha256, names, [])
    return ReadScene(snapshot=snapshot, snapshot_sha256=content, files=known)


def read_hashed_side_file(
    scene: SceneFolder, name: str, kind: type[T], files: FrozenFiles
) -> SideFile[T] | None:
    """A side file that is among the hashed artefacts; None where there is none.

    Raises as `read_side_file` does, and SceneInvalidError when it is no longer what was hashed.
    """
    side_file, hashed = read_side_file(scene.path, name, kind), files.artefacts.get(name)
    if (side_file and side_file.sha256) != (hashed and hashed.sha256):
        raise _changed(scene, name)
    return side_file


def _changed(scene: SceneFolder, name: str) -> SceneInvalidError:
    """What to raise for a file that was replaced while it was read; frozen.json is asked first."""
    checked_artefacts(scene, require_frozen=False)
    return SceneInvalidError(
        f"{name} changed while it was read",
        found="another sha256 after reading than before",
        expected="a scene that nobody writes to",
        next_step="wait until the scene is complete, then run again",
    )
