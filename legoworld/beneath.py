"""Files below a folder that an untrusted program can write to, reached by descriptors alone.

Such a program can swap any name below the folder between a folder and a link at any moment: what a
path was found to be says nothing of where it leads when it is opened. Here every part of a name is
opened below the part before it and no link is followed, by openat2 where the kernel has it and
component by component where not.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import functools
import os
import platform
import secrets
import stat
import sys
from collections.abc import Iterable, Iterator
from io import BufferedReader
from pathlib import Path, PurePath, PurePosixPath
from typing import Final, Self

from legoworld.errors import LegoWorldError, Raised
from legoworld.files import TEMPORARY_SUFFIX, atomic_path, kind_of_file, refused_by_machine

_FOLDER: Final = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
#: Opening never waits for the other end of a FIFO, and takes no terminal.
_FILE: Final = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
_NEW: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
_BLOCK: Final = 1 << 20
_OPENAT2: Final = 437  # of every architecture of Linux but alpha
_AT_CWD: Final = -100
#: RESOLVE_NO_MAGICLINKS, RESOLVE_NO_SYMLINKS, RESOLVE_BENEATH of linux/openat2.h.
_RESOLVE: Final = 0x02 | 0x04 | 0x08


class RefusedFileError(LegoWorldError):
    """What is below the folder under a name is not read, and nothing is written in its place."""

    code = "file_refused"


class Beneath:
    """An open folder that an untrusted program can write to, and the files below it.

    folder: no link, and its own path is ours: no program can change what it names. One that the
    program can replace, such as its output, is a name below the folder that it is in.
    Every method raises RefusedFileError for a name that leads out of the folder or through a link,
    and OSError where the machine refuses (no space, no descriptors).
    """

    def __init__(self, folder: Path) -> None:
        with _translate_errors(folder):
            self._top = os.open(folder, _FOLDER)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: Raised) -> None:
        self.close()

    def close(self) -> None:
        """Close the folder; what is below it stays."""
        if self._top >= 0:
            os.close(self._top)
            self._top = -1

    @contextlib.contextmanager
    def open_file(
        self, name: str | PurePath, *, most_bytes: int
    ) -> Iterator[BufferedReader | None]:
        """A file for reading; None where nothing has the name.

        RefusedFileError for all but a regular file of at most `most_bytes` under one name alone: a
        second name may be outside of the folder.
        """
        descriptor = None
        with _translate_errors(name), self._parent(name) as (folder, last):
            if folder is not None:
                with contextlib.suppress(FileNotFoundError):
                    descriptor = os.open(last, _FILE, dir_fd=folder)
        if descriptor is None:
            yield None
            return
        try:
            _check(name, os.fstat(descriptor), most_bytes)
            with os.fdopen(descriptor, "rb", closefd=False) as stream:
                yield stream
        finally:
            os.close(descriptor)

    def read(self, name: str | PurePath, *, most_bytes: int) -> bytes | None:
        """A file's bytes; None where nothing has the name."""
        with self.open_file(name, most_bytes=most_bytes) as stream:
            if stream is None:
                return None
            return b"".join(_blocks(name, stream, most_bytes))

    def copy_out(self, name: str | PurePath, target: Path, *, most_bytes: int) -> bool:
        """Copy a file to a path of ours, whole or not at all; False where nothing has the name.

        The program may hold the file open: what is copied does not change any more.
        """
        with self.open_file(name, most_bytes=most_bytes) as stream:
            if stream is None:
                return False
            with atomic_path(target) as unfinished, unfinished.open("wb") as copy:
                for block in _blocks(name, stream, most_bytes):
                    copy.write(block)
        return True

    def move_out(self, name: str | PurePath, target: Path, *, folder: bool = False) -> bool:
        """Move a file, or a folder, to a path of ours; False where nothing has the name.

        Of a program that has ended: one that runs could have it open still. A folder's content is
        as the program left it. RefusedFileError for a link or device, and a file of two names.
        """
        if (status := self.status(name)) is None:
            return False
        if not folder or not stat.S_ISDIR(status.st_mode):
            _check(name, status, status.st_size)
        with _translate_errors(name), self._parent(name) as (parent, last):
            if parent is None:
                return False
            os.rename(last, target, src_dir_fd=parent)
        if not folder:
            target.chmod(0o644)
        return True

    def write(self, name: str | PurePath, data: bytes, *, new: bool = False) -> None:
        """Write a file, in the place of what has the name; with `new` RefusedFileError for that."""
        self._write(name, [data], new=new)

    def copy_in(self, source: Path, name: str | PurePath) -> None:
        """Copy a file of ours, in the place of what has the name."""
        with source.open("rb") as stream:
            self._write(name, iter(lambda: stream.read(_BLOCK), b""), new=False)

    def names(self, name: str | PurePath = ".") -> list[str]:
        """The names in a folder, sorted; none where there is no such folder."""
        with _translate_errors(name), self._folder(_parts(name)) as folder:
            return [] if folder is None else sorted(os.listdir(folder))  # noqa: PTH208  a descriptor

    def status(self, name: str | PurePath) -> os.stat_result | None:
        """What has a name, a link itself and not what it names; None for nothing."""
        with _translate_errors(name), self._parent(name) as (folder, last):
            if folder is not None:
                with contextlib.suppress(FileNotFoundError):
                    return os.stat(last, dir_fd=folder, follow_symlinks=False)
        return None

    def unlink(self, name: str | PurePath) -> None:
        """Remove a name that is no folder's; nothing happens where it is not there."""
        with _translate_errors(name), self._parent(name) as (folder, last):
            if folder is not None:
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(last, dir_fd=folder)

    def make_folder(self, name: str | PurePath) -> None:
        """Create a folder and its missing parents."""
        parts = _parts(name)
        for depth in range(len(parts) + 1):  # the last round refuses what is no folder
            with _translate_errors(name), self._folder(parts[:depth]) as above:
                if above is None:
                    raise _refused_error(str(name), "its folder was removed")
                if depth < len(parts):
                    with contextlib.suppress(FileExistsError):
                        os.mkdir(parts[depth], dir_fd=above)

    def _write(self, name: str | PurePath, blocks: Iterable[bytes], *, new: bool) -> None:
        with _translate_errors(name), self._parent(name) as (folder, last):
            if folder is None:
                raise _refused_error(str(name), "no such folder")
            written = last if new else f".{secrets.token_hex(8)}{TEMPORARY_SUFFIX}"
            with os.fdopen(os.open(written, _NEW, 0o644, dir_fd=folder), "wb") as stream:
                try:
                    for block in blocks:
                        stream.write(block)
                    stream.flush()
                    if not new:
                        os.rename(written, last, src_dir_fd=folder, dst_dir_fd=folder)
                except BaseException:
                    with contextlib.suppress(OSError):
                        os.unlink(written, dir_fd=folder)
                    raise

    @contextlib.contextmanager
    def _parent(self, name: str | PurePath) -> Iterator[tuple[int | None, str]]:
        """The folder that a name is in, and the last part of the name."""
        parts = _parts(name)
        if not parts:
            raise _refused_error(str(name), "the folder itself")
        with self._folder(parts[:-1]) as folder:
            yield folder, parts[-1]

    @contextlib.contextmanager
    def _folder(self, parts: tuple[str, ...]) -> Iterator[int | None]:
        """A folder's descriptor; None where nothing has the name."""
        opener = _open_with_openat2 if has_openat2() else _open_folder
        try:
            opened = opener(self._top, parts)
        except FileNotFoundError:
            yield None
            return
        try:
            yield opened
        finally:
            os.close(opened)


def name_beneath(path: str, folder: Path) -> PurePath | None:
    """The name below `folder` that an untrusted path means, no link followed; None for no such.

    folder: as it is called, and as it is with links resolved.
    """
    if "\0" in path or not path:
        return None
    asked = os.path.normpath(os.path.abspath(path))  # noqa: PTH100  ".." by the letter
    for top in (folder.absolute(), folder.resolve()):
        with contextlib.suppress(ValueError):
            return PurePath(asked).relative_to(top)
    return None


@functools.cache
def has_openat2() -> bool:
    """Whether the kernel has openat2 (Linux 5.6) and no filter of system calls forbids it."""
    if sys.platform != "linux" or platform.machine() == "alpha":
        return False
    try:
        os.close(_open_with_openat2(_AT_CWD, ()))
    except OSError:
        return False
    return True


class _OpenHow(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_uint64) for name in ("flags", "mode", "resolve"))


def _open_with_openat2(top: int, parts: tuple[str, ...]) -> int:
    """The descriptor of a folder below another, by one openat2."""
    how = _OpenHow(flags=_FOLDER, mode=0, resolve=_RESOLVE)
    path = os.fsencode("/".join(parts) or ".")
    libc = ctypes.CDLL(None, use_errno=True)
    opened = int(libc.syscall(_OPENAT2, top, path, ctypes.byref(how), ctypes.sizeof(how)))
    if opened < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), "/".join(parts))
    return opened


def _open_folder(top: int, parts: tuple[str, ...]) -> int:
    """The descriptor of a folder below another, by one openat for each part."""
    opened = os.dup(top)
    for part in parts:
        try:
            below = os.open(part, _FOLDER, dir_fd=opened)
        finally:
            os.close(opened)
        opened = below
    return opened


def _parts(name: str | PurePath) -> tuple[str, ...]:
    """The parts of a relative name, none for the folder itself."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\0" in str(name):
        raise _refused_error(str(name), "it leads out of the folder")
    return path.parts


@contextlib.contextmanager
def _translate_errors(name: str | PurePath) -> Iterator[None]:
    """What the system says of a name as a RefusedFileError; the machine's own words as they are."""
    try:
        yield
    except OSError as error:
        if refused_by_machine(error):
            raise
        linked = error.errno in (errno.ELOOP, errno.ENOTDIR, errno.EXDEV)
        found = "a link, or a file in the place of a folder" if linked else error.strerror
        raise _refused_error(str(name), found or str(error)) from error
    except UnicodeEncodeError as error:
        raise _refused_error(str(name), "a name that no file can have") from error


def _check(name: str | PurePath, status: os.stat_result, most_bytes: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise _refused_error(str(name), kind_of_file(status.st_mode))
    if status.st_nlink != 1:
        raise _refused_error(str(name), "a file with another name, too")
    if status.st_size > most_bytes:
        raise _refused_error(
            str(name), f"{status.st_size:,} bytes", f"at most {most_bytes:,} bytes"
        )


def _blocks(name: str | PurePath, stream: BufferedReader, most_bytes: int) -> Iterator[bytes]:
    """A file's bytes, also of one that grows while it is read."""
    left = most_bytes
    while block := stream.read(_BLOCK):
        left -= len(block)
        if left < 0:
            raise _refused_error(str(name), "a file that grows", f"at most {most_bytes:,} bytes")
        yield block


def _refused_error(name: str, found: str, expected: str = "") -> RefusedFileError:
    return RefusedFileError(
        f"{name!r} is not used: a program can write to its folder",
        found=found,
        expected=expected or "a regular file of one name, through no link",
    )
