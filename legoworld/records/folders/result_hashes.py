"""The sha256 of a finished run's result files in its run.json: a changed byte is seen.

Depth files have theirs in their rows. run.json of before schema 2 has none, and nothing is checked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from legoworld.files import sha256_of_file

#: run.json's key for {file's name in the run folder: sha256}.
RESULTS: Final = "results_sha256"
#: The schema of run.json; 2 added `results_sha256`.
RUN_SCHEMA: Final = 2


def hashes(folder: Path, files: Iterable[Path]) -> dict[str, str]:
    """The sha256 of those of a folder's files that are there, by their names in it."""
    return {
        path.relative_to(folder).as_posix(): sha256_of_file(path)
        for path in files
        if path.is_file()
    }


def altered(folder: Path, document: Any, files: Iterable[Path]) -> list[str]:
    """Names of the files that are there and not as run.json, `document`, has them on record."""
    recorded = document.get(RESULTS) if isinstance(document, dict) else None
    if not isinstance(recorded, Mapping):
        return []
    found = hashes(folder, files)
    return [name for name, sha256 in found.items() if recorded.get(name) != sha256]
