"""Reading, hashing and atomic writing of files; one JSON style for everything that is compared."""

from __future__ import annotations

import codecs
import errno
import hashlib
import json
import os
import stat
import threading
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

from legoworld.errors import UsageError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: A value of a JSON document.
Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"

TEMPORARY_SUFFIX: Final = ".tmp"
_SHOWN: Final = 50  # characters of a file's name in its temporary one
_MACHINE: Final = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOSPC, errno.EDQUOT,
                   errno.EROFS, errno.EFBIG)  # fmt: skip
_KINDS: Final = (
    (stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a FIFO"), (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"), (stat.S_ISBLK, "a device"), (stat.S_ISLNK, "a link"),
)  # fmt: skip


#: The longer one first: it begins with the other.
_OTHER_MARKS: Final = (
    (codecs.BOM_UTF32_LE, "UTF-32"),
    (codecs.BOM_UTF32_BE, "UTF-32"),
    (codecs.BOM_UTF16_LE, "UTF-16"),
    (codecs.BOM_UTF16_BE, "UTF-16"),
)


def sha256_of_file(path: Path) -> str:
    """Hex sha256 of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def home_folder() -> Path:
    """The user's home; the root for a user without HOME and without a passwd entry."""
    try:
        return Path.home()
    except RuntimeError:
        return Path("/")


def refused_by_machine(error: OSError) -> bool:
    """Whether the error is this machine's (disk, memory, open files), not the file's."""
    return error.errno in _MACHINE


def refuse_existing(path: Path, *, overwrite: bool) -> None:
    """UsageError for an output file that is there, unless it may be replaced; never a folder."""
    folder = path.is_dir()
    if folder or (path.exists() and not overwrite):
        raise UsageError(
            f"{path} already exists",
            found="a folder" if folder else "a file",
            expected="a new file",
            next_step="choose another -o" + ("" if folder else ", or pass --overwrite"),
        )


def names_a_file(path: Path) -> bool:
    """Whether a file of this untrusted name exists; False for a name too long to be a path."""
    try:
        return path.is_file()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            return False
        raise


def kind_of_file(mode: int) -> str:
    """The kind of a directory entry, from its `st_mode`."""
    return next((kind for matches, kind in _KINDS if matches(mode)), "a regular file")


@contextmanager
def open_regular(path: Path) -> Iterator[BufferedReader]:
    """Open an untrusted file for reading: links are followed, and opening never blocks.

    Raises NotRegularError for a folder, FIFO, socket or device.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno == errno.ENXIO:  # a socket, or a device without a driver
            raise NotRegularError(errno.EINVAL, "it is a socket", str(path)) from error
        raise
    try:
        mode = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode):
            raise NotRegularError(errno.EINVAL, f"it is {kind_of_file(mode)}", str(path))
        with os.fdopen(descriptor, "rb", closefd=False) as stream:
            yield stream
    finally:
        os.close(descriptor)


class NotRegularError(OSError):
    """The path is not a regular file; strerror says what it is."""


class EncodingError(ValueError):
    """Bytes are not UTF-8 text; the message says what they are."""


def utf8_text(data: bytes) -> str:
    """Bytes of a text file as text, a UTF-8 byte order mark left out. EncodingError."""
    for mark, name in _OTHER_MARKS:
        if data.startswith(mark):
            raise EncodingError(f"it is {name} text, not UTF-8: save it again as UTF-8")
    if b"\0" in data[:4]:
        raise EncodingError("it is UTF-16 text or no text, not UTF-8: save it again as UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        found = f"byte 0x{data[error.start]:02x} at position {error.start}"
        raise EncodingError(f"it is not UTF-8: {error.reason}, {found}") from error


def as_unicode(text: str) -> str:
    """The text with lone surrogates escaped; file names may contain them."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def sha256_of_text(text: str) -> str:
    """Hex sha256 of a text's UTF-8 bytes."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


_CANONICAL: Final = json.JSONEncoder(
    sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False
)


def canonical_json(value: Json) -> str:
    """One line of JSON with sorted keys: equal values give equal bytes. NaN and inf are refused."""
    return _CANONICAL.encode(value)


def readable_json(value: Json) -> str:
    """Indented JSON with sorted keys and a final newline, for files people open.

    Equal to json.dumps(indent=1), which falls back to the pure-Python encoder when it indents.
    """
    import msgspec  # programs that write no such file start faster

    line = canonical_json(value).encode("utf-8", "surrogatepass")
    return msgspec.json.format(line, indent=1).decode("utf-8", "surrogatepass") + "\n"


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that replaces it when the block ends without an error.

    A killed process leaves the temporary file behind; its name starts with "." and ends in
    `TEMPORARY_SUFFIX`, so that the next run can delete it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # A name may be as long as the file system allows; its temporary one needs room for the rest.
    shown = path.name
    if len(shown) > _SHOWN:
        shown = f"{shown[:_SHOWN]}-{zlib.crc32(os.fsencode(shown)):08x}"
    name = f".{shown}.{os.getpid()}-{threading.get_ident()}{TEMPORARY_SUFFIX}"
    temporary = path.with_name(name)
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        # A full disk does not say which file, a read-only one names the temporary one.
        if error.filename in (None, str(temporary)):
            error.filename = str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def sync_file(path: Path) -> None:
    """Flush a file's content to disk. OSError names the file."""
    _sync(path, os.O_RDONLY)


def sync_folder(folder: Path) -> None:
    """Flush a folder's directory entries to disk, where the system supports it."""
    try:
        _sync(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some network file systems
            raise


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
    finally:
        os.close(descriptor)


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(text.encode("utf-8"))


def write_npz(path: Path, arrays: Mapping[str, ArrayLike], *, compressed: bool = False) -> None:
    """Write np.savez's bytes atomically.

    An interrupted np.savez leaves its archive to the garbage collector, which then prints a
    complaint on standard error.
    """
    import zipfile

    import numpy as np

    method = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w", method) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                np.lib.format.write_array(  # type: ignore[no-untyped-call]
                    stream, np.asanyarray(values), allow_pickle=False
                )
