"""A scene folder to its snapshot: checked, hashed, and opened only when it must be."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from legoworld.errors import SceneInvalidError, cause
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache, files_in
from legoworld.scene.folder import BLEND, GLB, SceneFolder, Source, find_scene
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


@dataclass(frozen=True, kw_only=True)
class _NewSnapshot:
    """A snapshot that was just made: in memory, or the file that Blender wrote.

    names: the files that the scene file reads; folders: in which more may appear.
    """

    snapshot: Snapshot | Path
    files: FrozenFiles
    names: list[str]
    folders: list[str]


def check_scene(
    scenes: Path, name: str, *, require_frozen: bool
) -> tuple[SceneFolder, FrozenFiles]:
    """A scene's folder, and its files as they are now, held to frozen.json.

    Raises as `find_scene` and `checked_artefacts` do; SceneInvalidError for a folder that cannot be
    accessed.
    """
    try:
        folder = find_scene(scenes, name)
        return folder, checked_artefacts(folder, require_frozen=require_frozen)
    except OSError as error:
        raise SceneInvalidError(
            f"the scene folder {name!r} cannot be looked at",
            found=cause(error),
            expected="a folder and files that may be read",
            next_step="correct its name or its permissions",
        ) from error


def read_scene(
    scene: SceneFolder,
    *,
    source: Source,
    blender: BlenderProcess,
    cache: SnapshotCache | None,
    files: FrozenFiles,
    any_camera: bool = False,
    corner_normals: bool = False,
) -> ReadScene:
    """The snapshot of a scene whose files were hashed by `checked_artefacts`.

    any_camera: give a scene without a camera one; it is not cached. corner_normals: whether the
    snapshot has them. Raises the typed verdicts of `errors`: missing, invalid, changed, failed or
    timeout.
    """
    name = BLEND if source == "blend" else GLB
    hashed = files.artefacts.get(name)
    if hashed is None:
        raise _missing_error(name, files)
    if any_camera:
        cache = None
    if cache is not None:
        stored = _load_cached(scene, name, hashed, cache, files, corner_normals=corner_normals)
        if stored is not None:
            return stored
    if source == "blend":
        made = _from_blend(
            scene,
            hashed,
            files,
            cache,
            blender,
            any_camera=any_camera,
            corner_normals=corner_normals,
        )
    else:
        made = _from_glb(scene, hashed, files, any_camera=any_camera, corner_normals=corner_normals)
    if cache is None:
        snapshot, content = _load_uncached(made)
    else:
        stored_at = cache.snapshot_path(
            hashed.sha256, made.files.dependencies, corner_normals=corner_normals
        )
        snapshot, content = _store_in_cache(made, hashed, cache, stored_at)
    return ReadScene(snapshot=snapshot, snapshot_sha256=content, files=made.files)


def _missing_error(name: str, files: FrozenFiles) -> SceneInvalidError:
    next_step = {
        (BLEND, True): "pass --source glb to `legoworld readout` or `inspect` to read scene.glb",
        (BLEND, False): "run the scene program with `legoworld execute`",
        (GLB, False): "export scene.glb, or use --source blend",
    }[name, GLB in files.artefacts]
    return SceneInvalidError(
        f"the scene folder holds no {name}",
        found=", ".join(files.artefacts) or "nothing",
        expected=name,
        next_step=next_step,
    )


def _load_cached(
    scene: SceneFolder,
    name: str,
    file_hash: FileHash,
    cache: SnapshotCache,
    files: FrozenFiles,
    *,
    corner_normals: bool,
) -> ReadScene | None:
    """The cached snapshot of a scene file; None where there is none that can be read.

    A damaged entry is made again, like one that is not there.
    """
    names = cache.dependencies(file_hash.sha256, scene.path)
    if names is None:
        return None
    # The same content may have been read under another name, beside another folder of simulations.
    names = sorted({*names, *files_in(scene.path, [scene.simulations])})
    known = hashed_dependencies(scene, names, files, read_by=name)
    try:
        path = cache.snapshot_path(
            file_hash.sha256, known.dependencies, corner_normals=corner_normals
        )
        snapshot, content = load(path)
    except SceneInvalidError:
        return None
    return ReadScene(snapshot=snapshot, snapshot_sha256=content, files=known)


def _from_blend(
    scene: SceneFolder,
    file_hash: FileHash,
    files: FrozenFiles,
    cache: SnapshotCache | None,
    blender: BlenderProcess,
    *,
    any_camera: bool,
    corner_normals: bool,
) -> _NewSnapshot:
    """Have Blender write the snapshot, on the cache's disk where it is to be kept there."""
    if cache is None:  # each snapshot takes the place of the one before
        workspace = blender.workspace("legoworld-snapshot-")
    else:
        with cache.translate_write_errors():
            cache.folder.mkdir(parents=True, exist_ok=True)
            workspace = blender.workspace(".reading-", cache.folder)
    output = workspace / "made.snapshot"
    answer = blender.request(
        {
            "kind": "snapshot",
            # The folder is resolved and the file is not: what it links lies beside the name.
            "blend": str(scene.path.resolve() / scene.name_on_disk(BLEND)),
            "output": str(output),
            "passing": cache is None,
            "any_camera": any_camera,
            "corner_normals": corner_normals,
        }
    )
    names = answer["dependencies"]
    known = hashed_dependencies(scene, names, files, read_by=BLEND)
    # The file may have been replaced meanwhile: what was hashed must be what was read.
    if not is_still(scene.path, scene.name_on_disk(BLEND), file_hash):
        raise _changed_error(scene, BLEND)
    return _NewSnapshot(snapshot=output, files=known, names=names, folders=answer["watched"])


def _from_glb(
    scene: SceneFolder,
    file_hash: FileHash,
    files: FrozenFiles,
    *,
    any_camera: bool,
    corner_normals: bool,
) -> _NewSnapshot:
    """Read scene.glb here, without Blender."""
    from legoworld.scene.gltf.buffers import external_files
    from legoworld.scene.gltf.container import parse_glb
    from legoworld.scene.gltf.snapshot import read_glb_snapshot

    data = scene.file(GLB).read_bytes()
    if hashlib.sha256(data).hexdigest() != file_hash.sha256:
        raise _changed_error(scene, GLB)
    parsed = parse_glb(data)
    names = external_files(parsed.document, scene.path)
    known = hashed_dependencies(scene, names, files, read_by=GLB)
    snapshot = read_glb_snapshot(
        parsed, scene.path, any_camera=any_camera, corner_normals=corner_normals
    )
    # A file beside it may have been replaced meanwhile: what was hashed must be what was read.
    if hash_files(scene.path, names) != known.dependencies:
        raise _changed_error(scene, GLB)
    return _NewSnapshot(snapshot=snapshot, files=known, names=names, folders=[])


def _load_uncached(new: _NewSnapshot) -> tuple[Snapshot, str]:
    """A snapshot that is not kept, and its content hash."""
    if isinstance(new.snapshot, Path):
        return load(new.snapshot, passing=True)
    return new.snapshot, new.snapshot.content_sha256()


def _store_in_cache(
    new: _NewSnapshot, file_hash: FileHash, cache: SnapshotCache, stored: Path
) -> tuple[Snapshot, str]:
    """A snapshot that is put into the cache, and its content hash."""
    with cache.translate_write_errors():
        if isinstance(new.snapshot, Path):
            stored.parent.mkdir(parents=True, exist_ok=True)
            new.snapshot.replace(stored)
            kept = load(stored)
        else:
            kept = new.snapshot, save(new.snapshot, stored)
        cache.put_dependencies(file_hash.sha256, new.names, new.folders)
    return kept


def read_hashed_side_file(
    scene: SceneFolder, name: str, kind: type[T], files: FrozenFiles
) -> SideFile[T] | None:
    """A side file that is among the hashed artefacts; None where there is none, as for a lone file.

    Raises as `read_side_file` does, and SceneInvalidError if it changed after it was hashed.
    """
    if scene.lone is not None:
        return None
    side_file, hashed = read_side_file(scene.path, name, kind), files.artefacts.get(name)
    if (side_file and side_file.sha256) != (hashed and hashed.sha256):
        raise _changed_error(scene, name)
    return side_file


def _changed_error(scene: SceneFolder, name: str) -> SceneInvalidError:
    """What to raise for a file that was replaced while it was read; frozen.json is asked first."""
    checked_artefacts(scene, require_frozen=False)
    return SceneInvalidError(
        f"{name} changed while it was read",
        found="another sha256 after reading than before",
        expected="a scene that is not being written to",
        next_step="wait until the scene is complete, then run again",
    )
