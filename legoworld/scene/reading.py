"""A scene folder to its snapshot: checked, hashed, and read by Blender only when it must be."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from legoworld.errors import SceneInvalidError
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import BLEND, SceneFolder, Source
from legoworld.scene.freeze import FrozenFiles, checked_artefacts, hash_files
from legoworld.scene.snapshot import Snapshot, load


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
        raise SceneInvalidError(
            "reading scene.glb without Blender is not built yet",
            found="--source glb",
            expected="--source blend",
            next_step="use --source blend",
        )
    blend = files.artefacts.get(BLEND)
    if blend is None:
        raise SceneInvalidError(
            "the scene folder holds no scene.blend",
            found=", ".join(files.artefacts) or "nothing",
            expected=BLEND,
            next_step="run the scene program with `legoworld execute`",
        )
    if cache is None:
        with tempfile.TemporaryDirectory(prefix="legoworld-") as folder:
            return _read(scene, blend.sha256, SnapshotCache(Path(folder)), blender, files)
    return _read(scene, blend.sha256, cache, blender, files)


def _read(
    scene: SceneFolder,
    blend_sha256: str,
    cache: SnapshotCache,
    blender: BlenderProcess,
    files: FrozenFiles,
) -> ReadScene:
    names = cache.dependencies(blend_sha256)
    if names is not None:
        known = replace(files, dependencies=hash_files(scene.path, names))
        stored = cache.snapshot_path(blend_sha256, known.dependencies)
        if stored.is_file():
            snapshot, content = load(stored)
            return ReadScene(snapshot=snapshot, snapshot_sha256=content, files=known)
    return _read_with_blender(scene, blend_sha256, cache, blender, files)


def _read_with_blender(
    scene: SceneFolder,
    blend_sha256: str,
    cache: SnapshotCache,
    blender: BlenderProcess,
    files: FrozenFiles,
) -> ReadScene:
    cache.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".reading-", dir=cache.folder) as folder:
        output = Path(folder) / "snapshot.npz"
        answer = blender.request(
            {
                "kind": "snapshot",
                "blend": str(scene.file(BLEND).resolve()),
                "output": str(output.resolve()),
            }
        )
        dependencies = hash_files(scene.path, answer["dependencies"])
        # The file may have been replaced meanwhile: what was hashed must be what was read.
        if hash_files(scene.path, [BLEND]) != {BLEND: files.artefacts[BLEND]}:
            checked_artefacts(scene, require_frozen=False)
            raise SceneInvalidError(
                "scene.blend changed while it was read",
                found="another sha256 after reading than before",
                expected="a scene that nobody writes to",
                next_step="wait until the scene is complete, then run again",
            )
        stored = cache.snapshot_path(blend_sha256, dependencies)
        stored.parent.mkdir(parents=True, exist_ok=True)
        output.replace(stored)
        cache.put_dependencies(blend_sha256, answer["dependencies"])
    snapshot, content = load(stored)
    return ReadScene(
        snapshot=snapshot,
        snapshot_sha256=content,
        files=replace(files, dependencies=dependencies),
    )
