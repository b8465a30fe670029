"""What differs between the files of two campaigns, by file and field."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from blend_fields import blend, differing

#: What no two trials share: times, and the hashes and sizes of .blend files, whose unset memory
#: differs (blend_fields.py names it).
OF_EACH_TRIAL = re.compile(
    r"[:.](at_s|seconds|agent_seconds|timestamp|sha256|bytes|time|duration\w*|[\w-]*id)$"
    r"|scene[.]blend\.|scene_blend|exit_code: 0$"
)


def differences(one: Path, other: Path) -> Counter[str]:
    """Each field in which the files of two folders differ, and how often."""
    found: Counter[str] = Counter()
    ours, theirs = _files(one), _files(other)
    for name in ours.keys() | theirs.keys():
        if name not in ours or name not in theirs:
            found[f"{_plain(name)}: only in {'one' if name in ours else 'the other'}"] += 1
        else:
            found.update(_differences(_plain(name), ours[name], theirs[name]))
    return found


def _files(folder: Path) -> dict[str, Path]:
    """Files by name; checkpoints, whose names are hashes, by their order instead."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.parent.name != "checkpoints":
            found[str(path.relative_to(folder))] = path
    for path in folder.rglob("checkpoints.jsonl"):
        for line in map(json.loads, path.read_text().splitlines()):
            name = f"{path.parent.relative_to(folder)}/checkpoints/{line['ordinal']}.blend"
            found[name] = path.parent / "checkpoints" / f"{line['sha256']}.blend"
    return found


def _plain(name: str) -> str:
    """A file's name without its scene and number."""
    name = re.sub(r"checkpoints/\d+", "checkpoints/N", name)
    return name.partition("/")[2] or name


def _differences(name: str, one: Path, other: Path) -> Iterator[str]:
    ours, theirs = one.read_bytes(), other.read_bytes()
    if ours == theirs:
        return
    if name.endswith(".blend"):
        for field, count in differing(blend(one), blend(other)).items():
            yield from [f"{name}: {field}"] * count
        return
    try:
        yield from sorted(_compared(f"{name}:", _read(ours), _read(theirs)))
    except ValueError:
        yield f"{name}: bytes"


def _read(data: bytes) -> Any:
    """A JSON document, or lines of them."""
    text = data.decode()
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return [json.loads(line) for line in text.splitlines()]


def _compared(where: str, one: Any, other: Any) -> Iterator[str]:
    if isinstance(one, dict) and isinstance(other, dict):
        for key in one.keys() | other.keys():
            joint = "" if where.endswith(":") else "."
            yield from _compared(f"{where}{joint}{key}", one.get(key), other.get(key))
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            yield f"{where} ({len(other) - len(one):+} items)"
        for ours, theirs in zip(one, other, strict=False):
            yield from _compared(where, ours, theirs)
    elif one != other:
        yield where
