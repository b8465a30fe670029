"""The files a .blend refers to, looked at before Blender reads them, and fonts it cannot read."""

from __future__ import annotations

import gzip
import os
import stat
import struct
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any, Final

import bpy
import zstandard  # comes with bpy

from legoworld.errors import IrregularFileError
from legoworld.files import kind_of_file
from legoworld.scene.blender.dependencies import cache_folders, library_path

_ZSTD: Final = b"\x28\xb5\x2f\xfd"
_GZIP: Final = b"\x1f\x8b"
_LARGEST_LIBRARY: Final = 1 << 16


def refuse_irregular_libraries(blend: Path) -> None:
    """Raise IrregularFileError if a file links a library that is a FIFO, socket or device.

    Blender reads libraries while it opens the file, and opening a FIFO never ends: their paths are
    taken from the file's own blocks. Other files are left to Blender.
    """
    with blend.open("rb") as stream:
        start = stream.read(4)
        stream.seek(0)
        _refuse(_linked_paths(blend.parent, _library_blocks(_open_unpacked(stream, start))))


def irregular_files() -> list[tuple[str, Path]]:
    """What a FIFO, socket or device is that the open file reads, and its path."""
    paths = bpy.utils.blend_paths(absolute=True, packed=False, local=False)
    libraries = map(library_path, bpy.data.libraries)
    caches = (p for folder in cache_folders(Path(bpy.data.filepath)) for p in folder.rglob("*"))
    return list(_irregular((*map(Path, paths), *libraries, *caches)))


def refuse_irregular_files() -> None:
    """Raise IrregularFileError if the open file references anything but regular files."""
    _refuse(path for _, path in irregular_files())


def font_warnings() -> list[str]:
    """A warning for each font in use that Blender replaces by its own: texts get another size."""
    fonts = [f for f in bpy.data.fonts if f.users and f.filepath not in ("", "<builtin>")]
    warnings = []
    for font in sorted(fonts, key=lambda f: (f.name, f.filepath)):
        reason = _unreadable(font)
        if reason:
            where = "in the file" if font.packed_file else Path(font.filepath).name
            warnings.append(
                f"font {font.name!r} ({where}) cannot be read: {reason}; Blender's own font is "
                "used, and texts have another size"
            )
    return warnings


def _unreadable(font: bpy.types.VectorFont) -> str:
    """Why Blender cannot load a font; "" where it can."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(bpy.path.abspath(font.filepath, library=font.library))
        if font.packed_file is not None:
            path = Path(folder) / "font"
            path.write_bytes(font.packed_file.data)
        try:
            loaded = bpy.data.fonts.load(str(path), check_existing=False)
        except RuntimeError as error:
            return str(error).rpartition(": ")[2].strip().lower()
    bpy.data.fonts.remove(loaded)
    return ""


def _refuse(paths: Iterable[Path]) -> None:
    for kind, path in _irregular(paths):
        raise IrregularFileError(
            "scene.blend references a path that is not a regular file",
            found=f"{path.name} is {kind}",
            expected="regular files",
            next_step="pack the data into the .blend, or put the file in that place",
        )


def _irregular(paths: Iterable[Path]) -> Iterator[tuple[str, Path]]:
    for path in paths:
        try:
            mode = os.stat(path).st_mode  # noqa: PTH116  a link's target counts
        except (OSError, ValueError):
            continue
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            yield kind_of_file(mode), path


def _open_unpacked(stream: IO[bytes], start: bytes) -> Any:
    """The stream of a .blend's blocks, which reads and seeks forwards."""
    if start[:2] == _GZIP:
        return gzip.open(stream)
    if start == _ZSTD:
        unpacker = zstandard.ZstdDecompressor()
        return unpacker.stream_reader(stream, read_across_frames=True, closefd=False)
    return stream


def _linked_paths(folder: Path, blocks: Iterable[bytes]) -> Iterator[Path]:
    """Whatever may be a path in the blocks of libraries."""
    for block in blocks:
        for text in block.split(b"\0"):
            if text.startswith(b"//"):
                yield folder / os.fsdecode(text[2:])
            elif text.startswith(b"/"):
                yield Path(os.fsdecode(text))


def _library_blocks(stream: Any) -> Iterator[bytes]:
    """The content of a .blend's LI blocks; ends at the first damage.

    The header's forms: BLENDER17-01v0500 (5.0), BLENDER-v401 and BLENDER_v401 (8 and 4 byte
    pointers; V: big-endian).
    """
    try:
        start = stream.read(12)
        if start[:7] != b"BLENDER":
            return
        if start[7:9].isdigit():
            stream.read(int(start[7:9]) - len(start))
            layout, place = struct.Struct("<4sIQqq"), 3
        else:
            order, pointer = "<>"[start[8:9] == b"V"], "IQ"[start[7:8] == b"-"]
            layout, place = struct.Struct(f"{order}4si{pointer}ii"), 1
        while len(head := stream.read(layout.size)) == layout.size:
            fields = layout.unpack(head)
            code, length = fields[0], fields[place]
            if code == b"ENDB" or length < 0:
                return
            if code == b"LI\0\0" and length <= _LARGEST_LIBRARY:
                yield stream.read(length)
            else:
                stream.seek(length, os.SEEK_CUR)
    except (OSError, EOFError, ValueError, zlib.error, zstandard.ZstdError):
        return
