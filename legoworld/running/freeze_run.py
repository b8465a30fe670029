"""`legoworld freeze`: check every artefact and record its content."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path, PurePath
from typing import Final

from legoworld.errors import (
    LegoWorldError,
    SceneInvalidError,
    WorkerCrashedError,
    WorkerMemoryError,
    WorkerTimeoutError,
    cause,
)
from legoworld.files import TEMPORARY_SUFFIX
from legoworld.records.scene_folder import OK, FrozenRow, ProvenanceFile, Verdict
from legoworld.scene.artefacts import check_glb, check_picture
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache, bpy_version
from legoworld.scene.folder import (
    BLEND,
    FROZEN,
    GLB,
    LABELS,
    PICTURE,
    PROVENANCE,
    SceneFolder,
    find_scene,
    leaves_scenes,
)
from legoworld.scene.freeze import (
    FileHash,
    FrozenFiles,
    Hashes,
    hash_files,
    list_program_warnings,
    write_frozen,
)
from legoworld.scene.labels import read_labels_file
from legoworld.scene.read_scene import read_scene
from legoworld.scene.side_files import read_side_file
from legoworld.tracks.track import make_folder_track
from legoworld.workers.engines import ENGINES, EngineName, Job, machine_lost

#: A limit that was reached is not a lasting property of a scene: it is not recorded.
_NOT_THE_SCENES_FAULT: Final = (
    WorkerCrashedError.code,
    WorkerMemoryError.code,
    WorkerTimeoutError.code,
)


def freeze_scenes(
    scenes: Path,
    *,
    engine: EngineName,
    workers: int,
    cache: SnapshotCache | None,
    limits: Limits,
    total: Callable[[int], None] = lambda _: None,
    row: Callable[[FrozenRow], None] = lambda _: None,
) -> list[FrozenRow]:
    """Freeze every scene folder below SCENES; one row per scene, sorted by name.

    total: called with the number of scenes; row: with each scene's row as it is done.
    """
    folders = [find_scene(scenes, image.scene) for image in make_folder_track(scenes).images]
    job = Job(make=partial(_Freezer, cache, limits), lost_result=_lost_row)
    total(len(folders))
    done = []
    with closing(ENGINES[engine](job, folders, workers)) as rows:
        for one in rows:
            row(one)
            done.append(one)
    return sorted(done, key=lambda row: row.scene)


class _Freezer:
    """Freezes scenes with its own Blender process."""

    def __init__(self, cache: SnapshotCache | None, limits: Limits) -> None:
        self._cache = cache
        self._blender = BlenderProcess(limits)

    def do(self, folder: SceneFolder) -> FrozenRow:
        return freeze_scene(folder, blender=self._blender, cache=self._cache)

    def abort(self) -> None:
        self._blender.abort()

    def close(self) -> None:
        self._blender.close()


def _lost_row(folder: SceneFolder, what: str) -> FrozenRow:
    checks = {BLEND: _complaint(machine_lost(what))}
    return FrozenRow(scene=folder.name, status="failed", checks=checks, warnings=[])


def freeze_scene(
    folder: SceneFolder, *, blender: BlenderProcess, cache: SnapshotCache | None
) -> FrozenRow:
    """Check one scene's artefacts and write its frozen.json; return the table row."""
    for leftover in folder.path.glob(f".{FROZEN}.*{TEMPORARY_SUFFIX}"):  # of a killed freeze
        leftover.unlink(missing_ok=True)
    artefacts, unusable = _hash_artefacts(folder)
    files = FrozenFiles(artefacts=artefacts, dependencies={}, frozen="at_readout")
    checks, dependencies = _check_blend(folder, files, blender, cache)
    checks |= unusable
    if GLB in artefacts:
        checks[GLB] = _check(lambda: check_glb(folder.file(GLB)))
    if PICTURE in artefacts:
        checks[PICTURE] = _check(lambda: check_picture(folder.file(PICTURE)))
    if LABELS in artefacts:
        checks[LABELS] = _check(lambda: read_labels_file(folder.file(LABELS)))
    if PROVENANCE in artefacts:
        checks[PROVENANCE] = _check(lambda: read_side_file(folder.path, PROVENANCE, ProvenanceFile))
    if checks[BLEND].code not in _NOT_THE_SCENES_FAULT:
        write_frozen(folder, artefacts, dependencies, checks, bpy=bpy_version())
    good = all(check.status == "ok" for check in checks.values())
    return FrozenRow(
        scene=folder.name,
        status="ok" if good else "invalid",
        checks=checks,
        warnings=[*list_program_warnings(folder, artefacts), *_not_portable(folder, dependencies)],
    )


def _not_portable(folder: SceneFolder, dependencies: Hashes) -> list[str]:
    """Files that the scene reads but that do not move with it to another machine."""
    return [
        f"{BLEND} reads {PurePath(name).name} from outside of the scenes: on another machine the "
        "scene is not this one; pack the file into the .blend or put it beside it"
        for name, hashed in dependencies.items()
        if hashed is not None and leaves_scenes(name, folder)
    ]


def _hash_artefacts(folder: SceneFolder) -> tuple[dict[str, FileHash | None], dict[str, Verdict]]:
    """The artefacts' hashes, and a failed check for each unreadable one."""
    hashes: dict[str, FileHash | None] = {}
    complaints = {}
    for name in folder.artefacts():
        try:
            hashes |= hash_files(folder.path, [name])
        except SceneInvalidError as error:
            complaints[name] = _complaint(error)
    return hashes, complaints


def _check_blend(
    folder: SceneFolder, files: FrozenFiles, blender: BlenderProcess, cache: SnapshotCache | None
) -> tuple[dict[str, Verdict], Hashes]:
    """The check of scene.blend, and the other files it reads."""
    try:
        read = read_scene(folder, source="blend", blender=blender, cache=cache, files=files)
    except LegoWorldError as error:
        return {BLEND: _complaint(error)}, {}
    return {BLEND: OK}, read.files.dependencies


def _check(check: Callable[[], object]) -> Verdict:
    try:
        check()
    except LegoWorldError as error:
        return _complaint(error)
    except OSError as error:
        what, expected = "the file cannot be read", "a readable file"
        return _complaint(SceneInvalidError(what, found=cause(error), expected=expected))
    return OK


def _complaint(error: LegoWorldError) -> Verdict:
    return Verdict(status=error.status, code=error.code, reason=str(error))
