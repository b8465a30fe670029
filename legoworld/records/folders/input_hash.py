"""The hash of an input of a score: of its bytes, and of a run.json without its time.

run.json is the one file of a run that says when it was made. Two runs that differ in nothing else
are the same input, so that their evaluations and comparisons have the same bytes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from legoworld.files import canonical_json, sha256_of_file

#: Keys of run.json that its hash leaves out.
TIMES: Final = ("finished_at",)


def excluded_keys(role: str) -> tuple[str, ...]:
    """The keys that the hash of an input leaves out."""
    return TIMES if role == "run" else ()


def hash_and_size(path: Path, without: Sequence[str] = ()) -> tuple[str, int]:
    """sha256 and bytes of a file; of its canonical JSON without some keys where any are named.

    ValueError when such a file is no JSON object.
    """
    if not without:
        return sha256_of_file(path), path.stat().st_size
    document = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(document, dict):
        raise ValueError(f"not an object: {type(document).__name__}")
    kept = {key: value for key, value in document.items() if key not in without}
    content = canonical_json(kept).encode()
    return hashlib.sha256(content).hexdigest(), len(content)
