"""The JSON files beside a scene: untrusted input, read through one function.

A scene folder is untrusted input. The content of a side file is copied into results, so a
file that is not the folder's own (a link to a private one) must never be read as one; and reading
must end: no FIFO, no device, no endless file, no nesting that exhausts the stack.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final, Generic, TypeVar

from legoworld.errors import LabelsInvalidError, SideFileInvalidError, cause, one_line
from legoworld.files import kind_of_file, refused_by_machine
from legoworld.records.base import RecordError, decode_foreign
from legoworld.records.scene_folder import ExecutionFile
from legoworld.scene.folder import BLEND, EXECUTION, FROZEN, LABELS, PROVENANCE

#: The side files, and how many bytes each may have.
SIZE_LIMITS: Final = {
    LABELS: 16 << 20,  # 70,000 entries take 7 MiB
    PROVENANCE: 256 << 10,  # is copied into run.json for every scene
    FROZEN: 32 << 20,  # 200,000 dependencies
    EXECUTION: 1 << 20,
}
#: How deep lists and objects of a side file may be nested.
NESTING_LIMIT: Final = 64
_NO_LINK: Final = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class SideFile(Generic[T]):
    """What a side file says, and what identifies the bytes it was read from."""

    value: T
    sha256: str
    bytes: int


def read_side_file(folder: Path, name: str, kind: type[T]) -> SideFile[T] | None:
    """One of `SIZE_LIMITS` of a scene folder as a value of its type; None when there is none.

    Raises LabelsInvalidError (labels.json) or SideFileInvalidError for a link that leaves the
    folder, anything but a regular file, a file over its limit, text that is not UTF-8 or holds
    half a surrogate pair, what is not JSON (NaN, infinity, nesting beyond `NESTING_LIMIT`), and
    what is not of the type.
    """
    data = bytes_beside(folder, name, SIZE_LIMITS[name])
    if data is None:
        return None
    try:
        value = decode_foreign(kind, data, levels=NESTING_LIMIT)
    except RecordError as error:
        raise invalid(name, str(error)) from error
    return SideFile(value=value, sha256=hashlib.sha256(data).hexdigest(), bytes=len(data))


def hash_side_file(folder: Path, name: str) -> tuple[str, int] | None:
    """sha256 and size of a side file; None when there is none.

    Raises as `read_side_file` does for what is not a file of the folder; the content may be
    anything.
    """
    data = bytes_beside(folder, name, SIZE_LIMITS[name])
    return None if data is None else (hashlib.sha256(data).hexdigest(), len(data))


def program_warnings(folder: Path, blend_sha256: str | None) -> tuple[str, ...]:
    """A warning where the program that built the scene was stopped by an error.

    blend_sha256: of the scene.blend that is there; an execution.json of another one says nothing of
    it. The file does not belong to the frozen scene, so an unusable one is only a warning.
    """
    try:
        record = read_side_file(folder, EXECUTION, ExecutionFile)
    except SideFileInvalidError as error:
        return (f"{error.what}; found: {error.found}",)
    if record is None or record.value.status != "stopped":
        return ()
    if record.value.files.get(BLEND) != blend_sha256:
        return ()
    by = record.value.error
    where = f" at line {by.line}" if by and by.line is not None else ""
    kind = one_line(by.type, 100) if by else "an error"
    return (
        f"the program that built the scene stopped{where} ({kind}): the scene is what it had built "
        "by then",
    )


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
    kind = "JSON file" if name in SIZE_LIMITS else "file"
    return SideFileInvalidError(
        f"{name} cannot be used",
        found=found,
        expected=f"a {kind} of the scene folder itself"
        + (", as `legoworld freeze` writes it" if name == FROZEN else ""),
        next_step="freeze the scene again" if name == FROZEN else f"correct {name}, or delete it",
    )


def bytes_beside(folder: Path, name: str, limit: int) -> bytes | None:
    """The bytes of a file of the folder itself; None when there is none.

    Raises as `read_side_file` does for a link that leaves the folder, what is not a regular file,
    and more than `limit` bytes.
    """
    try:
        with _open_below(folder, name) as descriptor:
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
        raise invalid(name, f"it cannot be opened: {cause(error)}") from error
    if len(data) > limit:
        raise invalid(name, f"it has more than {limit:,} bytes, the most that are read")
    return data


@contextmanager
def _open_below(folder: Path, name: str) -> Iterator[int]:
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
