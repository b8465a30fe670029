"""Freezing: the sha256 of every file a scene consists of, put on record and checked."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Final, Literal

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import NotFrozenError, SceneChangedError, SceneInvalidError, cause
from legoworld.files import (
    NotRegularError,
    open_regular,
    refused_by_machine,
    sha256_of_text,
    write_text,
)
from legoworld.records.base import canonical, readable
from legoworld.records.scene_folder import FrozenFile, HashedFile, Verdict
from legoworld.scene.folder import (
    ARTEFACTS,
    BLEND,
    FROZEN,
    GLB,
    LABELS,
    PICTURE,
    PROGRAM,
    URDF_SUFFIX,
    SceneFolder,
    leaves_scenes,
    outside_name,
    recorded_name,
)
from legoworld.scene.side_files import SIZE_LIMITS, hash_side_file, program_warnings, read_side_file
from legoworld.version import __version__

#: sha256 and size of a file by its path relative to the scene folder; None: it was not there.
Hashes = Mapping[str, "FileHash | None"]
#: A file without blocks on the disk may claim any size, and hashing it would not end.
LARGEST_BYTES: Final = 64 << 30
_COVERED_AT_FIRST: Final = (BLEND, GLB, PICTURE, PROGRAM, LABELS)


#: A file changed less long than this before it was looked at may change again without its times
#: showing it: clocks of file systems tick in milliseconds to seconds.
_SETTLED_NS: Final = 3_000_000_000


@dataclass(frozen=True, kw_only=True)
class FileHash:
    """What identifies a file's content.

    stamp: device, inode, size, and times of the last change of content and of inode, taken before
    it was hashed; None where they would not tell a later change. No part of what the hash is.
    """

    sha256: str
    bytes: int
    stamp: tuple[int, ...] | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class FrozenFiles:
    """The files of a scene as they are now. `frozen` tells whether a frozen.json vouches.

    dependencies: until the scene file was read, what frozen.json lists.
    """

    artefacts: Hashes
    dependencies: Hashes
    frozen: Literal["frozen.json", "at_readout"]
    warnings: tuple[str, ...] = ()

    @property
    def sha256(self) -> str:
        """One hash over the content of all files."""
        return sha256_of_text(canonical([_plain(self.artefacts), _plain(self.dependencies)]))


def hash_files(folder: Path, names: Iterable[str]) -> dict[str, FileHash | None]:
    """The content of each file, None for one that is not there.

    Raises SceneInvalidError for one that is not a regular file, cannot be read, or is too large.
    """
    return {name: _file_hash(folder, name) for name in sorted(names)}


def hash_artefacts(scene: SceneFolder) -> dict[str, FileHash | None]:
    """The content of a scene's artefacts. Raises as `hash_files` does."""
    return {n: _file_hash(scene.path, scene.name_on_disk(n)) for n in sorted(scene.artefacts())}


def _file_hash(folder: Path, name: str) -> FileHash | None:
    if name in SIZE_LIMITS:
        hashed = hash_side_file(folder, name)
        return FileHash(sha256=hashed[0], bytes=hashed[1]) if hashed else None
    try:
        with open_regular(folder / name) as stream:
            status = os.fstat(stream.fileno())
            size = status.st_size
            if size > LARGEST_BYTES:
                raise _unusable(name, f"{size:,} bytes, limit {LARGEST_BYTES:,}")
            settled = time.time_ns() - max(status.st_ctime_ns, status.st_mtime_ns) > _SETTLED_NS
            return FileHash(
                sha256=hashlib.file_digest(stream, "sha256").hexdigest(),
                bytes=size,
                stamp=_stamp(status) if settled else None,
            )
    except (FileNotFoundError, NotADirectoryError):
        return None
    except NotRegularError as error:
        if name not in ARTEFACTS and (folder / name).is_dir():
            return None  # a folder of caches: the files in it are dependencies of their own
        raise _unusable(name, cause(error)) from error
    except OSError as error:
        if refused_by_machine(error):
            raise
        raise _unusable(name, cause(error)) from error
    except ValueError as error:  # a name with a null character
        raise _unusable(name, str(error)) from error


def is_still(folder: Path, name: str, before: FileHash) -> bool:
    """Whether a file has the content it had when it was hashed.

    Its stamp vouches for it where it has one; it is hashed again where it has none or another one.
    """
    if before.stamp is not None:
        try:
            # Opened, because a network file system then asks its server: it need not for a stat.
            with open_regular(folder / name) as stream:
                if _stamp(os.fstat(stream.fileno())) == before.stamp:
                    return True
        except OSError:
            pass  # hashing says what it is
    return hash_files(folder, [name]) == {name: before}


def _stamp(status: os.stat_result) -> tuple[int, ...]:
    return (
        status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
    )  # fmt: skip


def _unusable(name: str, found: str) -> SceneInvalidError:
    return SceneInvalidError(
        f"{name} cannot be read",
        found=found,
        expected="a regular file that may be read",
        next_step="deliver the file, correct its permissions, or leave it out of the scene",
    )


def write_frozen(
    scene: SceneFolder,
    artefacts: Hashes,
    dependencies: Hashes,
    checks: Mapping[str, Verdict],
    *,
    bpy: str | None = None,
) -> None:
    """Write frozen.json: the hashes, and the verdict of each artefact's check.

    bpy: the version that opened scene.blend. It stands for all that ships with Blender.
    """
    good = all(check.status == "ok" for check in checks.values())
    record = FrozenFile(
        schema_version=SCHEMA_VERSION,
        legoworld=__version__,
        bpy=bpy,
        status="ok" if good else "invalid",
        checks=dict(checks),
        covers=ARTEFACTS,
        files=_plain(artefacts),
        dependencies=_plain(dependencies),
    )
    write_text(scene.file(FROZEN), readable(record))


def checked_artefacts(scene: SceneFolder, *, require_frozen: bool) -> FrozenFiles:
    """Hash the scene's files now and compare with frozen.json where there is one.

    Raises SceneChangedError when a file differs, appeared or went, NotFrozenError when a record
    is required and missing. Without a record the dependencies are not known yet: empty.
    """
    side_file = None if scene.lone else read_side_file(scene.path, FROZEN, FrozenFile)
    now = hash_artefacts(scene)
    if side_file is None:
        if require_frozen:
            raise NotFrozenError(
                "the scene is not frozen",
                found=f"no {FROZEN}",
                expected=f"{FROZEN} beside the scene",
                next_step="run `legoworld freeze` on the scenes first",
            )
        warnings = list_program_warnings(scene, now)
        return FrozenFiles(artefacts=now, dependencies={}, frozen="at_readout", warnings=warnings)
    record = side_file.value
    if require_frozen and record.status != "ok":
        raise NotFrozenError(
            "the scene was frozen with a complaint",
            found=f"{FROZEN} says {record.status}",
            expected="a scene whose artefacts all passed their check",
            next_step="see its checks, correct the scene and freeze it again",
        )
    files, dependencies = _hashes(record.files), _hashes(record.dependencies)
    # A record that does not say was made when provenance.json was not part of it.
    covers = {*_COVERED_AT_FIRST, *record.covers}
    covered = [n for n in {*now, *files} if n in covers or n.endswith(URDF_SUFFIX)]
    _refuse_changes(files, {n: now.get(n) for n in covered})
    # What lies elsewhere is compared when the scene file was read and has said where it lies.
    near = {n: h for n, h in dependencies.items() if not leaves_scenes(n, scene)}
    _refuse_changes(near, hash_files(scene.path, near))
    return FrozenFiles(
        artefacts=now,
        dependencies=dependencies,
        frozen="frozen.json",
        warnings=list_program_warnings(scene, now),
    )


def list_program_warnings(scene: SceneFolder, artefacts: Hashes) -> tuple[str, ...]:
    """A warning where the program that built the scene.blend of these hashes was stopped."""
    if scene.lone is not None:
        return ()
    blend = artefacts.get(BLEND)
    return program_warnings(scene.path, blend.sha256 if blend else None)


def hashed_dependencies(
    scene: SceneFolder, names: Iterable[str], files: FrozenFiles, *, read_by: str
) -> FrozenFiles:
    """The files of a scene whose scene file, `read_by`, reads these others.

    Raises SceneInvalidError when there is a frozen.json that does not list one of them, and
    SceneChangedError when one outside of SCENES is not what it lists. A name that frozen.json
    lists and the scene file does not read is a warning.
    """
    real = {_recorded_name(name, scene, files): name for name in names}
    hashes = {
        recorded: hash_files(scene.path, [name])[name] for recorded, name in sorted(real.items())
    }
    warnings: tuple[str, ...] = ()
    if files.frozen == "frozen.json":
        _refuse_unlisted(read_by, [n for n in hashes if n not in files.dependencies])
        far = {n: h for n, h in files.dependencies.items() if leaves_scenes(n, scene)}
        if read_by == BLEND:
            _refuse_changes(
                {n: h for n, h in far.items() if n in hashes},
                {n: h for n, h in hashes.items() if n in far},
            )
            warnings = tuple(
                f"{FROZEN} lists {PurePath(n).name}, which {BLEND} does not read: freeze the scene "
                "again, so that it can be read on other machines"
                for n in sorted({*far} - {*hashes})
            )
    return replace(files, dependencies=hashes, warnings=(*files.warnings, *warnings))


def _recorded_name(name: str, scene: SceneFolder, files: FrozenFiles) -> str:
    """The name that a dependency has on record.

    Records of the first kind hold paths, and what lies outside depends on where SCENES begins: a
    scene may be frozen by itself and read among others.
    """
    known = (n for n in (name, outside_name(name)) if n in files.dependencies)
    return next(known, recorded_name(name, scene))


def _refuse_unlisted(read_by: str, unlisted: list[str]) -> None:
    if unlisted:
        raise SceneInvalidError(
            f"{read_by} reads files that frozen.json does not list",
            found=", ".join(unlisted[:5]),
            expected="a record of every file the scene consists of",
            next_step="freeze the scene again; a .glb must have everything embedded",
        )


def _refuse_changes(recorded: Hashes, now: Hashes) -> None:
    for name in sorted({*recorded, *now}):
        before, after = recorded.get(name), now.get(name)
        if before != after:
            raise SceneChangedError(
                f"{name} is not the file that was frozen",
                found=f"sha256 {after.sha256[:16]}" if after else "no file",
                expected=f"sha256 {before.sha256[:16]}" if before else "no file",
                next_step=f"restore {name}, or freeze the scene again",
            )


def _plain(hashes: Hashes) -> dict[str, HashedFile | None]:
    return {
        name: HashedFile(sha256=hashed.sha256, bytes=hashed.bytes) if hashed else None
        for name, hashed in hashes.items()
    }


def _hashes(recorded: Mapping[str, HashedFile | None]) -> dict[str, FileHash | None]:
    return {
        name: FileHash(sha256=file.sha256, bytes=file.bytes) if file else None
        for name, file in recorded.items()
    }
