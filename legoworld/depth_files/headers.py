"""Sizes claimed by the headers of depth files, checked before allocating anything of that size."""

from __future__ import annotations

import math
import struct
import tokenize
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from legoworld.depth_files.errors import DepthFileError
from legoworld.errors import cause

#: Called with (width, height) before the array is read; raises if the size is unusable.
SizeCheck = Callable[[tuple[int, int]], None]

#: 16384 x 16384. No camera has more pixels, and their float64 is 2 GiB.
MOST_PX: Final = 1 << 28
_PNG: Final = b"\x89PNG\r\n\x1a\n"
#: Bytes of a PNG chunk besides its data: length, type and checksum.
_PNG_CHUNK: Final = 12
_LONGEST_TEXT_HEADER: Final = 4096
#: Exceptions of NumPy's .npy header parser for invalid text.
_BAD_HEADER: Final = (
    ValueError,
    KeyError,
    TypeError,
    OverflowError,
    RecursionError,
    MemoryError,
    SyntaxError,
    tokenize.TokenError,
)
#: Types of a TIFF field that hold integers, by number: bytes and struct's letter.
_TIFF_INTEGERS: Final = {1: (1, "B"), 3: (2, "H"), 4: (4, "I"), 16: (8, "Q")}
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_SAMPLES = 256, 257, 277


def picture_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """An array's shape without axes of length 1 before or after the image's two axes."""
    while len(shape) > 2 and shape[0] == 1:
        shape = shape[1:]
    while len(shape) > 2 and shape[-1] == 1:
        shape = shape[:-1]
    return shape


def check_claim(
    path: Path, shape: tuple[int, ...], check_size: SizeCheck | None, channels: int = 1
) -> None:
    """Refuse a shape that is not an image, is too large, or differs from the caller's size.

    Raises DepthFileError, and what `check_size` raises.
    """
    if channels > 1 and shape[-1:] != (channels,):
        raise DepthFileError(
            f"{path.name} is not one picture of {channels} channels",
            found=f"shape {shape}",
            expected=f"(height, width, {channels})",
        )
    height_width = picture_shape(shape if channels == 1 else shape[:-1])
    if len(height_width) != 2 or min(height_width) < 1:
        raise DepthFileError(
            f"{path.name} is not one depth image",
            found=f"shape {shape}",
            expected="(height, width)",
        )
    height, width = height_width
    if width * height > MOST_PX:
        raise DepthFileError(
            f"{path.name} claims an impossible image size",
            found=f"{width}x{height}",
            expected=f"at most {MOST_PX} pixels",
            next_step="write the array again; its header may be damaged",
        )
    if check_size is not None:
        check_size((width, height))


def npy_claim(
    path: Path, stream: IO[bytes], data_bytes: int
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of the .npy at a stream's current position.

    data_bytes: of the whole .npy, header included. DepthFileError if it is not an .npy of plain
    numbers or text, or holds fewer bytes than its header says.
    """
    start = stream.tell()
    try:
        version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
        readers = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }
        shape, _, dtype = readers[version](stream)  # type: ignore[no-untyped-call]
    except _BAD_HEADER as error:
        raise DepthFileError(
            f"{path.name} cannot be read",
            found=str(error) or type(error).__name__,
            expected="an .npy of plain numbers",
        ) from error
    if dtype.hasobject:
        raise DepthFileError(
            f"{path.name} cannot be read", found="Python objects", expected="plain numbers"
        )
    needed = math.prod(shape) * dtype.itemsize
    left = data_bytes - (stream.tell() - start)
    if any(side < 0 for side in shape) or needed > left:
        raise DepthFileError(
            f"{path.name} cannot be read: it is truncated, or its header is damaged",
            found=f"{left} bytes of numbers",
            expected=f"{needed} for {dtype} of shape {shape}",
        )
    return shape, dtype


def pfm_claim(path: Path) -> tuple[tuple[int, int], float, int]:
    """(height, width), scale and the offset of the pixels in a one-channel PFM.

    Raises DepthFileError for another header.
    """
    with path.open("rb") as stream:
        magic = stream.readline(16).strip()
        header = [stream.readline(64)]
        while header[-1].startswith(b"#"):
            header[-1] = stream.readline(64)
        header.append(stream.readline(64))
        place = stream.tell()
    try:
        width, height = (int(x) for x in header[0].split())
        scale = float(header[1])
    except ValueError:
        width = height = 0
        scale = 0.0
    if magic != b"Pf" or min(width, height) < 1 or not math.isfinite(scale) or scale == 0:
        raise DepthFileError(
            f"{path.name} is not a one-channel PFM",
            found=repr(b" ".join([magic, *(h.strip() for h in header)]))[:100],
            expected="Pf, width and height, a scale whose sign is the byte order",
        )
    return (height, width), scale, place


def png_claim(path: Path) -> tuple[int, ...]:
    """The shape claimed by a PNG's IHDR chunk; every chunk must be inside the file.

    Decoders allocate the length that a chunk claims, up to 4 GiB, before reading it. Raises
    DepthFileError for a damaged file.
    """
    with path.open("rb") as stream:
        start = stream.read(26)
        if len(start) < 26 or start[:8] != _PNG or start[8:16] != b"\0\0\0\x0dIHDR":
            raise DepthFileError(f"{path.name} cannot be read", expected="a 16-bit PNG")
        place, end, kind = len(_PNG), path.stat().st_size, b""
        while kind != b"IEND" and place + _PNG_CHUNK <= end:
            stream.seek(place)
            length, kind = struct.unpack(">I4s", stream.read(8))
            place += _PNG_CHUNK + length
    if kind != b"IEND" or place > end:
        raise DepthFileError(
            f"{path.name} cannot be read: it is cut, or damaged",
            found=f"{end} bytes",
            expected="chunks that lie in the file, the last of them IEND",
        )
    width, height = struct.unpack(">II", start[16:24])
    return (height, width)


def pgm_claim(path: Path) -> tuple[int, ...]:
    """The shape claimed by a PGM's header; a binary file must have the bytes for it.

    Raises DepthFileError for another header and for a truncated file.
    """
    with path.open("rb") as stream:
        start = stream.read(_LONGEST_TEXT_HEADER)
    uncommented = b" ".join(line.split(b"#")[0] for line in start.split(b"\n"))
    words = uncommented.split()[:4]
    if len(words) < 4 or words[0] not in (b"P2", b"P5") or not all(w.isdigit() for w in words[1:]):
        raise DepthFileError(f"{path.name} cannot be read", expected="a 16-bit PGM")
    width, height, largest = (int(word) for word in words[1:])
    needed = width * height * (2 if largest > 255 else 1)
    if words[0] == b"P5" and path.stat().st_size < needed:
        raise DepthFileError(
            f"{path.name} is truncated or has a damaged header",
            found=f"{path.stat().st_size} bytes",
            expected=f"{needed} for {width}x{height}",
        )
    return (height, width)


def tiff_claim(path: Path) -> tuple[int, ...]:
    """The shape of a TIFF's only image, (height, width) or (height, width, channels).

    Raises DepthFileError for several images and for a file without a size.
    """
    try:
        with path.open("rb") as stream:
            fields, following = _first_directory(stream)
    except (OSError, struct.error, KeyError, ValueError, OverflowError) as error:
        raise DepthFileError(
            f"{path.name} cannot be read", found=cause(error), expected="a TIFF of one channel"
        ) from error
    if following:
        raise DepthFileError(
            f"{path.name} is not one depth image",
            found="several images in one TIFF",
            expected="one",
        )
    if _TIFF_WIDTH not in fields or _TIFF_HEIGHT not in fields:
        raise DepthFileError(f"{path.name} cannot be read", expected="a TIFF with a size")
    samples = fields.get(_TIFF_SAMPLES, 1)
    return (fields[_TIFF_HEIGHT], fields[_TIFF_WIDTH], *([samples] if samples != 1 else []))


def _first_directory(stream: IO[bytes]) -> tuple[dict[int, int], int]:
    """A TIFF's first directory: integer fields by tag, and the offset of the next directory.

    TIFF 6.0 (Adobe, 1992), section 2; BigTIFF has 8-byte counts and offsets.
    """
    order = {b"II": "<", b"MM": ">"}[stream.read(2)]

    def take(layout: str) -> tuple[Any, ...]:
        layout = order + layout
        return struct.unpack(layout, stream.read(struct.calcsize(layout)))

    (magic,) = take("H")
    if magic not in (42, 43):
        raise ValueError(f"magic number {magic}")
    big = magic == 43
    count_letter, word = ("Q", "Q") if big else ("H", "I")
    (place,) = take("HHQ")[2:] if big else take("I")
    stream.seek(place)
    (count,) = take(count_letter)
    fields: dict[int, int] = {}
    for _ in range(min(count, 1 << 16)):
        tag, kind, length = take("HH" + word)
        value = stream.read(8 if big else 4)
        if length == 1 and kind in _TIFF_INTEGERS:
            size, letter = _TIFF_INTEGERS[kind]
            fields[tag] = struct.unpack(order + letter, value[:size])[0]
    return fields, take(word)[0]
