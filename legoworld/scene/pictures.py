"""Picture files of strangers: their sizes by the header, before anything is decoded."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import SceneInvalidError

#: Of a picture that a scene folder brings: 8K is 33.2 million pixels.
MOST_PX: Final = 1 << 25
#: Of a photo, which the user names: 67 million.
MOST_PHOTO_PX: Final = 1 << 26
#: What is decoded, for messages.
FORMATS: Final = "a JPEG, PNG, WebP, BMP, TIFF or PPM"
PNG: Final = b"\x89PNG\r\n\x1a\n"
JPEG: Final = b"\xff\xd8\xff"
#: Markers of a JPEG with the frame's size (ITU T.81, table B.1), and those without a length.
_FRAMES: Final = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
_ALONE: Final = frozenset({0x01, *range(0xD0, 0xD9)})
#: Netpbm's header: kind, width, height, with comments between them.
_PNM: Final = re.compile(rb"P[1-6](?:\s+|#[^\n]*\n)+(\d{1,9})(?:\s+|#[^\n]*\n)+(\d{1,9})\s")


class PictureTooLargeError(SceneInvalidError):
    """A picture's header claims more pixels than are decoded."""

    code = "picture_too_large"


def decoded_picture(
    data: bytes, *, color: bool = False, most_px: int = MOST_PX, name: str = "a picture"
) -> NDArray[Any] | None:
    """The pixels of a picture (FORMATS) in OpenCV's order, without EXIF rotation.

    None for anything else and for what does not decode. color: always (H, W, 3) uint8 BGR;
    otherwise as stored. most_px: raises PictureTooLargeError for a header that claims more.
    """
    import cv2

    width, height = claimed_size_wh(data)
    if width * height > most_px:
        raise PictureTooLargeError(
            f"{name} is too large to be decoded",
            found=f"{width}x{height} pixels in {len(data):,} bytes",
            expected=f"at most {most_px:,} pixels",
            next_step="write it smaller",
        )
    ends = not data.startswith(PNG) or any(kind == b"IEND" for kind, _, _ in png_chunks(data))
    if min(width, height) < 1 or not ends:
        return None
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION if color else cv2.IMREAD_UNCHANGED
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None


def claimed_size_wh(data: bytes) -> tuple[int, int]:
    """Width and height by the header of a picture (FORMATS); (0, 0) for anything else."""
    if data[:8] == PNG and len(data) >= 33:
        width, height = struct.unpack_from(">II", data, 16)
        return width, height
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP" and len(data) >= 30:
        return _webp_size_wh(data)
    if data[:3] == JPEG:
        return _jpeg_size_wh(data)
    if data[:2] == b"BM" and len(data) >= 26:
        (header,) = struct.unpack_from("<I", data, 14)
        width, height = struct.unpack_from("<HH" if header == 12 else "<ii", data, 18)
        return abs(width), abs(height)
    if data[:4] in (b"II*\0", b"MM\0*") and len(data) >= 8:
        return _tiff_size_wh(data)
    header = _PNM.match(data)
    return (int(header[1]), int(header[2])) if header else (0, 0)


def png_chunks(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Kind, start and end of a PNG's chunks up to the first that does not lie in the file.

    Decoders allocate any length that a chunk claims.
    """
    start = len(PNG)
    while start + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, start)
        end = start + 12 + length
        if end > len(data):
            return
        yield kind, start, end
        start = end


def _webp_size_wh(data: bytes) -> tuple[int, int]:
    """Canvas size of the first chunk: extended, lossless, or lossy (which has no alpha)."""
    if data[12:16] == b"VP8X":
        return (
            int.from_bytes(data[24:27], "little") + 1,
            int.from_bytes(data[27:30], "little") + 1,
        )
    if data[12:16] == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if data[12:16] == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return 0, 0


def _jpeg_size_wh(data: bytes) -> tuple[int, int]:
    """The size in the first frame header; bytes between segments are skipped, as libjpeg does."""
    at = 2
    while (at := data.find(b"\xff", at)) >= 0 and at + 9 <= len(data):
        kind = data[at + 1]
        if kind in _FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        if kind in (0x00, 0xFF) or kind in _ALONE:
            at += 1 if kind == 0xFF else 2
        else:
            at += 2 + struct.unpack_from(">H", data, at + 2)[0]
    return 0, 0


def _tiff_size_wh(data: bytes) -> tuple[int, int]:
    """ImageWidth and ImageLength, tags 256 and 257 of the first directory (TIFF 6.0, section 2)."""
    order = "<" if data[:2] == b"II" else ">"
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    sizes = {256: 0, 257: 0}
    if start + 2 <= len(data):
        (entries,) = struct.unpack_from(f"{order}H", data, start)
        for at in range(start + 2, min(start + 2 + 12 * entries, len(data) - 11), 12):
            tag, kind = struct.unpack_from(f"{order}HH", data, at)
            if tag in sizes and kind in (3, 4):
                number = f"{order}{'H' if kind == 3 else 'I'}"
                (sizes[tag],) = struct.unpack_from(number, data, at + 8)
    return sizes[256], sizes[257]
