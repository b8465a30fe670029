"""What numbers were made with: weight files by their hash, libraries by their version."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

_CHUNK_BYTES = 1 << 22


def hash_files(
    paths: Iterable[str | Path], root: str | Path | None = None
) -> list[dict[str, str | int]]:
    """{"name", "bytes", "sha256"} of each file, sorted by name.

    Names are relative to `root`, or the files' own names: where weights lie on a machine is no
    part of what they are.
    """
    found = []
    for path in map(Path, paths):
        digest = hashlib.sha256()
        with path.open("rb") as stream:
            while chunk := stream.read(_CHUNK_BYTES):
                digest.update(chunk)
        name = path.relative_to(root).as_posix() if root is not None else path.name
        found.append({"name": name, "bytes": path.stat().st_size, "sha256": digest.hexdigest()})
    return sorted(found, key=lambda entry: str(entry["name"]))


def library_versions(names: Iterable[str]) -> dict[str, str]:
    """The installed version by distribution name, and Python's; "not installed" where it is not."""
    found = {"python": platform.python_version()}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return dict(sorted(found.items()))
