"""A submission that was sent over HTTP: a .tar, a .zip or a .blend, unpacked within limits.

Nothing of it is decoded here but the archive's own headers, and no read is larger than
`_LONGEST_READ`: what a header claims decides neither memory nor time.
"""

from __future__ import annotations

import io
import os
import stat
import tarfile
import tempfile
import time
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from struct import error as StructError  # noqa: N812  a class with a small name
from typing import IO, Final

from legoworld.errors import LegoWorldError, cause
from legoworld.files import refused_by_machine
from legoworld.scene.folder import BLEND

_LONGEST_READ: Final = 1 << 18
_BLOCK: Final = 1 << 16
_LONGEST_PART: Final = 200
_DEEPEST: Final = 8
_BLENDS: Final = (b"BLENDER", b"\x28\xb5\x2f\xfd")  # plain, and compressed with Zstandard
_UNREADABLE: Final = (
    tarfile.TarError, zipfile.BadZipFile, zlib.error, StructError, EOFError, ValueError,
    OverflowError, RuntimeError, OSError,
)  # fmt: skip


class ArchiveError(LegoWorldError):
    """What was sent is no submission that is unpacked."""

    code = "archive"


@dataclass(frozen=True, kw_only=True)
class UnpackLimits:
    """Of one archive: bytes and files that it unpacks to, and the time that this takes."""

    unpacked_bytes: int
    files: int = 256
    time_s: float = 20.0


def unpack(upload: Path, name: str, limits: UnpackLimits) -> tuple[Path, bool]:
    """The scene folder, called `name`, in a new folder beside the upload; and whether it is lone.

    lone: a .blend alone was sent, which becomes the folder's scene.blend. An archive holds the
    scene's files, or one folder with them. Raises ArchiveError, and OSError for this machine's.
    """
    top = Path(tempfile.mkdtemp(prefix="unpacked-", dir=upload.parent))
    unpacked = top / "files"
    unpacked.mkdir()
    with _ShortReads(upload) as stream:
        head = stream.read(512)
        stream.seek(0)
        lone = head.startswith(_BLENDS)
        if lone:
            os.link(upload, unpacked / BLEND)
        else:
            _unpack_archive(stream, head, _Unpacking(unpacked, limits))
    inside = [*unpacked.iterdir()]
    one = len(inside) == 1 and inside[0].is_dir()
    (inside[0] if one else unpacked).rename(top / name)
    return top / name, lone


def _unpack_archive(stream: _ShortReads, head: bytes, unpacking: _Unpacking) -> None:
    try:
        if head.startswith(b"PK\x03\x04"):
            unpacking.write_all(_zip_members(stream))
        elif head[257:262] == b"ustar":
            unpacking.write_all(_tar_members(stream))
        else:
            raise _refusal(
                "another kind of file",
                expected="a .tar without compression, a .zip or a .blend",
            )
    except _UNREADABLE as error:
        if isinstance(error, OSError) and refused_by_machine(error):
            raise
        raise _refusal(f"{type(error).__name__}: {cause(error)}") from error


class _ShortReads(io.FileIO):
    """A file that refuses long reads, which only headers of hostile archives ask for."""

    def read(self, size: int | None = -1) -> bytes:
        """At most `size` bytes. ArchiveError for more than `_LONGEST_READ`."""
        rest = max(0, os.fstat(self.fileno()).st_size - self.tell())
        asked = rest if size is None or size < 0 else min(size, rest)
        if asked > _LONGEST_READ:
            raise _refusal(f"a header of {asked} bytes", expected=f"at most {_LONGEST_READ}")
        return super().read(asked)


@dataclass(frozen=True, kw_only=True)
class _Member:
    """One entry. stream: None for a folder; refusal: why it is not unpacked."""

    name: str
    size: int
    stream: IO[bytes] | None
    refusal: str | None


def _zip_members(stream: _ShortReads) -> Iterator[_Member]:
    with zipfile.ZipFile(stream) as archive:
        for info in archive.infolist():
            kind = stat.S_IFMT(info.external_attr >> 16)
            refusal = None
            if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                refusal = "a link or a device"
            elif info.flag_bits & 1:
                refusal = "encrypted"
            elif info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                refusal = f"compression method {info.compress_type}, not stored or deflated"
            source = None if refusal or info.is_dir() else archive.open(info)
            yield _Member(name=info.filename, size=info.file_size, stream=source, refusal=refusal)


def _tar_members(stream: _ShortReads) -> Iterator[_Member]:
    with tarfile.open(fileobj=stream, mode="r:") as archive:
        for info in archive:
            plain = info.type in (tarfile.REGTYPE, tarfile.AREGTYPE) and not info.issparse()
            refusal = None if plain or info.isdir() else "a link, a device or a sparse file"
            source = archive.extractfile(info) if plain else None
            yield _Member(name=info.name, size=info.size, stream=source, refusal=refusal)
        # tarfile ends at a header that is cut off or damaged as at the archive's end.
        stream.seek(archive.offset)
        if stream.read(tarfile.BLOCKSIZE).strip(b"\0") or stream.tell() % tarfile.BLOCKSIZE:
            raise tarfile.ReadError(f"no header at byte {archive.offset}")


class _Unpacking:
    """What was written of one archive so far, held to its limits."""

    def __init__(self, folder: Path, limits: UnpackLimits) -> None:
        self._folder, self._limits = folder, limits
        self._deadline = time.monotonic() + limits.time_s
        self._files = self._bytes = 0

    def write_all(self, members: Iterator[_Member]) -> None:
        """Write every file. ArchiveError for one that is refused, and beyond a limit."""
        limits = self._limits
        for member in members:
            self._files += 1
            if self._files > limits.files:
                raise _refusal("more entries", expected=f"at most {limits.files}")
            if member.refusal:
                raise _refusal(f"{member.name!r}: {member.refusal}")
            path = self._folder.joinpath(*_parts(member.name))
            if member.stream is None:
                continue  # a folder is made with what lies in it
            self._count(0, claimed=member.size)
            path.parent.mkdir(parents=True, exist_ok=True)
            with member.stream, path.open("xb") as target:
                while block := member.stream.read(_BLOCK):
                    self._count(len(block))
                    target.write(block)

    def _count(self, written: int, *, claimed: int = 0) -> None:
        self._bytes += written
        most = self._limits.unpacked_bytes
        if self._bytes + claimed > most:
            raise _refusal("more bytes unpacked", expected=f"at most {most}")
        if time.monotonic() > self._deadline:
            raise _refusal("more time", expected=f"at most {self._limits.time_s:g} s to unpack")


def _parts(name: str) -> list[str]:
    """The parts of an entry's name, below the folder. ArchiveError."""
    parts = [part for part in name.split("/") if part not in ("", ".")]
    if name.startswith("/") or "\\" in name or ".." in parts or not name.isprintable():
        raise _refusal(f"the name {name[:80]!r}", expected="a name below the folder")
    if len(parts) > _DEEPEST or any(len(os.fsencode(part)) > _LONGEST_PART for part in parts):
        raise _refusal(
            f"the name {name[:80]!r}",
            expected=f"at most {_DEEPEST} parts of {_LONGEST_PART} bytes",
        )
    return parts


def _refusal(found: str, *, expected: str = "") -> ArchiveError:
    return ArchiveError(
        "the submission that was sent is not unpacked",
        found=found,
        expected=expected or "plain files of a scene folder",
    )
