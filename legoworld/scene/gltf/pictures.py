"""The alpha of an embedded picture: PNG and WebP; JPEG has none."""

from __future__ import annotations

import struct
import zlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.pictures import JPEG, PNG, claimed_size_wh, png_chunks

LARGEST_SIDE_PX: Final = 16384

_MOST_PX: Final = 1 << 26

_PICTURE_CHUNKS: Final = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")


def read_alpha(data: bytes) -> tuple[NDArray[np.uint8] | None, str]:
    """(H, W) uint8 alpha, top row first, None if all 1; and the reason if it is unknown.

    The reason is empty if the alpha is known. `size_wh` gives what decoding will allocate.
    """
    if data[:3] == JPEG:
        return None, ""
    width, height = size_wh(data)
    if width == 0:
        return None, f"is neither PNG, WebP nor JPEG of at most {LARGEST_SIDE_PX} pixels a side"
    plain = _plain_png(data) if data[:8] == PNG else data
    if plain is None:
        return None, "does not decode"
    import cv2

    try:
        picture: Any = cv2.imdecode(np.frombuffer(plain, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        picture = None
    if picture is None or picture.shape[:2] != (height, width):
        return None, "does not decode"
    if picture.ndim < 3 or picture.shape[2] < 4:
        return None, ""
    alpha = picture[..., 3]
    if alpha.dtype == np.uint16:
        alpha = np.rint(alpha / 257.0)
    return np.ascontiguousarray(alpha.astype(np.uint8)), ""


def size_wh(data: bytes) -> tuple[int, int]:
    """Width and height by a PNG's or WebP's header, read before anything is allocated.

    (0, 0) for anything else and for pictures beyond `LARGEST_SIDE_PX` or 2^26 pixels.
    """
    size = claimed_size_wh(data) if data[:4] in (PNG[:4], b"RIFF") else (0, 0)
    sound = all(0 < side <= LARGEST_SIDE_PX for side in size) and size[0] * size[1] <= _MOST_PX
    return size if sound else (0, 0)


def _plain_png(data: bytes) -> bytes | None:
    """The PNG reduced to its image chunks; None if a chunk is truncated or damaged."""
    kept = [PNG]
    for kind, start, end in png_chunks(data):
        (checksum,) = struct.unpack_from(">I", data, end - 4)
        if zlib.crc32(data[start + 4 : end - 4]) != checksum:
            return None
        if kind in _PICTURE_CHUNKS:
            kept.append(data[start:end])
        if kind == b"IEND":
            return b"".join(kept)
    return None
