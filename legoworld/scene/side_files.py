"""The JSON files beside a scene: untrusted input, read through one function.

A scene folder comes from whoever made the scene. What a side file says is copied into results, so a
file that is not the folder's own (a link to a private one) must never be read as one; and reading
must end: no FIFO, no device, no endless file, no nesting that exhausts the stack.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from pathlib import Path, PurePosixPath
from typing import Any, Final, NoReturn

from legoworld.errors import LabelsInvalidError, SideFileInvalidError
from legoworld.files import is_unicode, kind_of_file, refused_by_machine
from legoworld.scene.folder import EXECUTION, FROZEN, LABELS, PROVENANCE

#: The side files, and how many bytes each may have.
SIZE_LIMITS: Final = {
    LABELS: 16 << 20,  # 70,000 entries take 7 MiB
    PROVENANCE: 256 << 10,  # is copied into run.json for every scene
    FROZEN: 32 << 20,  # 200,000 dependencies
    EXECUTION: 1 << 20,
}
#: How deep lists and objects of a side file may be nested.
NESTING_LIMIT: Final = 64
_TOO_DEEP: Final = f"lists or objects are nested beyond {NESTING_LIMIT} levels"
_NO_LINK: Final = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


@dataclass(frozen=True, kw_only=True)
class SideFile:
    """A side file's JSON value, and what identifies the bytes it was read from."""

    value: Any
    sha256: str
    bytes: int


def read_side_file(folder: Path, name: str) -> SideFile | None:
    """One of `SIZE_LIMITS` of a scene folder as JSON; None when there is no such file.

    Raises LabelsInvalidError (labels.json) or SideFileInvalidError for a link that leaves the
    folder, anything but a regular file, a file over its limit, text that is not UTF-8 or holds
    half a surrogate pair, and what is not JSON: NaN, infinity, nesting beyond `NESTING_LIMIT`.
    """
    data = _bytes_of(folder, name)
    if data is None:
        return None
    try:
        value = json.loads(data.decode("utf-8"), parse_constant=_refuse_constant)
    except RecursionError as error:
        raise invalid(name, _TOO_DEEP) from error
    except ValueError as error:
        raise invalid(name, f"it is not JSON: {error}") from error
    complaint = _complaint(value)
    if complaint is not None:
        raise invalid(name, complaint)
    return SideFile(value=value, sha256=hashlib.sha256(data).hexdigest(), bytes=len(data))


def hash_side_file(folder: Path, name: str) -> tuple[str, int] | None:
    """sha256 and size of a side file; None when there is none.

    Raises as `read_side_file` does for what is not a file of the folder; the content may be
    anything.
    """
    data = _bytes_of(folder, name)
    return None if data is None else (hashlib.sha256(data).hexdigest(), len(data))


def provenance_in(found: SideFile | None) -> dict[str, Any] | str:
    """What run.json says of how a scene was made, from its provenance.json.

    Raises SideFileInvalidError for what is no JSON object.
    """
    if found is None:
        return "not recorded"
    if not isinstance(found.value, dict):
        raise invalid(PROVENANCE, f"it holds a {type(found.value).__name__}, not an object")
    return found.value


def invalid(name: str, found: str) -> SideFileInvalidError | LabelsInvalidError:
    """The verdict of a side file that cannot be used."""
    if name == LABELS:
        return LabelsInvalidError(
            f"{LABELS} cannot be used",
            found=found,
            expected='{"version": 1, "labels": [{"object" or "collection": name, '
            '"category": name}]}',
            next_step=f"correct {LABELS}, or delete it to use the scene's own labels",
        )
    return SideFileInvalidError(
        f"{name} cannot be used",
        found=found,
        expected="a JSON file of the scene folder itself"
        + (", as `legoworld freeze` writes it" if name == FROZEN else ""),
        next_step="freeze the scene again" if name == FROZEN else f"correct {name}, or delete it",
    )


def _bytes_of(folder: Path, name: str) -> bytes | None:
    limit = SIZE_LIMITS[name]
    try:
        with _opened(folder, name) as descriptor:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise invalid(name, f"it is {kind_of_file(status.st_mode)}")
            with open(descriptor, "rb", closefd=False) as stream:
                data = stream.read(limit + 1)
    except FileNotFoundError:
        if not os.path.lexists(folder / name):
            return None
        raise invalid(name, "it is a link to a file that does not exist") from None
    except OSError as error:
        if refused_by_machine(error):
            raise
        raise invalid(name, f"it cannot be opened: {error.strerror}") from error
    if len(data) > limit:
        raise invalid(name, f"it has more than {limit:,} bytes, the most that are read")
    return data


@contextmanager
def _opened(folder: Path, name: str) -> Iterator[int]:
    """The descriptor of a file below the folder, reached without following any link out of it.

    The folder is opened once and everything is found from there, so that nothing that is exchanged
    meanwhile leads elsewhere. A link to another file of the folder is followed once.
    """
    top = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        descriptor = _descend(top, _parts_inside(top, name))
    finally:
        os.close(top)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _parts_inside(top: int, name: str) -> tuple[str, ...]:
    """The path below the folder: the name, or where a link of that name leads."""
    if not stat.S_ISLNK(os.stat(name, dir_fd=top, follow_symlinks=False).st_mode):
        return (name,)
    target = PurePosixPath(os.readlink(name, dir_fd=top))
    if target.is_absolute() or ".." in target.parts or not target.parts:
        raise invalid(name, "it is a link that leads out of the scene folder")
    return target.parts


def _descend(top: int, parts: tuple[str, ...]) -> int:
    at = os.dup(top)
    for i, part in enumerate(parts):
        flags = _NO_LINK if i == len(parts) - 1 else _NO_LINK | os.O_DIRECTORY
        try:
            below = os.open(part, flags, dir_fd=at)
        finally:
            os.close(at)
        at = below
    return at


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a JSON number")


def _complaint(value: Any) -> str | None:
    """What Python's reader lets through and results cannot hold; None for a good value."""
    level, depth = [value], 0
    while level:
        below: list[Any] = []
        for item in level:
            if isinstance(item, dict | list) and depth == NESTING_LIMIT:
                return _TOO_DEEP
            if isinstance(item, dict):
                below += [*item.keys(), *item.values()]
            elif isinstance(item, list):
                below += item
            elif isinstance(item, str) and not is_unicode(item):
                return f"{item!a} holds half of a surrogate pair"
            elif isinstance(item, float) and not isfinite(item):
                return "a number is beyond what a double can hold"
        level, depth = below, depth + 1
    return None
