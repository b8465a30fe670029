"""Freezing: the sha256 of every file a scene consists of, put on record and checked."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from legoworld import __version__
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import NotFrozenError, SceneChangedError, SceneInvalidError
from legoworld.files import (
    canonical_json,
    readable_json,
    sha256_of_file,
    sha256_of_text,
    write_text,
)
from legoworld.scene.folder import FROZEN, SceneFolder

#: sha256 and size of a file by its path relative to the scene folder; None: it was not there.
Hashes = Mapping[str, "FileHash | None"]


@dataclass(frozen=True, kw_only=True)
class FileHash:
    """What identifies a file's content."""

    sha256: str
    bytes: int


@dataclass(frozen=True, kw_only=True)
class FrozenFiles:
    """The files of a scene as they are now. `frozen` tells whether a frozen.json vouches."""

    artefacts: Hashes
    dependencies: Hashes
    frozen: Literal["frozen.json", "at_readout"]

    @property
    def sha256(self) -> str:
        """One hash over the content of all files."""
        return sha256_of_text(canonical_json([_plain(self.artefacts), _plain(self.dependencies)]))


def hash_files(folder: Path, names: Iterable[str]) -> dict[str, FileHash | None]:
    """The content of each file, None for one that is not there."""
    hashes: dict[str, FileHash | None] = {}
    for name in sorted(names):
        path = folder / name
        hashes[name] = (
            FileHash(sha256=sha256_of_file(path), bytes=path.stat().st_size)
            if path.is_file()
            else None
        )
    return hashes


def write_frozen(
    scene: SceneFolder,
    artefacts: Hashes,
    dependencies: Hashes,
    checks: Mapping[str, dict[str, Any]],
) -> None:
    """Write frozen.json: the hashes, and the verdict of each artefact's check."""
    good = all(check["status"] == "ok" for check in checks.values())
    document = {
        "schema_version": SCHEMA_VERSION,
        "legoworld": __version__,
        "status": "ok" if good else "invalid",
        "checks": dict(checks),
        "files": _plain(artefacts),
        "dependencies": _plain(dependencies),
    }
    write_text(scene.file(FROZEN), readable_json(document))


def read_frozen(scene: SceneFolder) -> tuple[Hashes, Hashes, str] | None:
    """Artefact and dependency hashes on record, and its status; None without a frozen.json."""
    path = scene.file(FROZEN)
    if not path.is_file():
        return None
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        return _typed(document["files"]), _typed(document["dependencies"]), document["status"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SceneInvalidError(
            f"{FROZEN} cannot be read",
            found=f"{type(error).__name__}: {error}",
            expected="the file that `legoworld freeze` writes",
            next_step="freeze the scene again",
        ) from error


def checked_artefacts(scene: SceneFolder, *, require_frozen: bool) -> FrozenFiles:
    """Hash the scene's files now and compare with frozen.json where there is one.

    Raises SceneChangedError when a file differs, appeared or went, NotFrozenError when a record
    is required and missing. Without a record the dependencies are not known yet: empty.
    """
    record = read_frozen(scene)
    now = hash_files(scene.path, scene.artefacts())
    if record is None:
        if require_frozen:
            raise NotFrozenError(
                "the scene is not frozen",
                found=f"no {FROZEN}",
                expected=f"{FROZEN} beside the scene",
                next_step="run `legoworld freeze` on the scenes first",
            )
        return FrozenFiles(artefacts=now, dependencies={}, frozen="at_readout")
    files, dependencies, status = record
    if require_frozen and status != "ok":
        raise NotFrozenError(
            "the scene was frozen with a complaint",
            found=f"{FROZEN} says {status}",
            expected="a scene whose artefacts all passed their check",
            next_step="see its checks, correct the scene and freeze it again",
        )
    _refuse_changes(files, now)
    _refuse_changes(dependencies, hash_files(scene.path, dependencies))
    return FrozenFiles(artefacts=now, dependencies=dependencies, frozen="frozen.json")


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


def _plain(hashes: Hashes) -> dict[str, dict[str, str | int] | None]:
    return {
        name: {"sha256": h.sha256, "bytes": h.bytes} if h else None
        for name, h in sorted(hashes.items())
    }


def _typed(hashes: dict[str, Any]) -> dict[str, FileHash | None]:
    return {
        name: FileHash(sha256=h["sha256"], bytes=h["bytes"]) if h else None
        for name, h in hashes.items()
    }
