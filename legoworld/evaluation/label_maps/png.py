"""PNGs of numbers: ids as colours, or categories as grey values or places of a palette."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from legoworld.errors import LegoWorldError, cause
from legoworld.files import open_regular
from legoworld.scene.pictures import MOST_PHOTO_PX, PNG, claimed_size_wh, png_chunks

_UNREADABLE = (OSError, SyntaxError, ValueError, EOFError, struct.error, zlib.error)


def read_ids(path: Path, error: type[LegoWorldError]) -> NDArray[np.int32]:
    """(H, W) ids of a colour PNG: R + 256 G + 65536 B."""
    pixels = _read(path, ("RGB", "RGBA"), error, "an 8-bit RGB PNG")
    red, green, blue = (pixels[..., k].astype(np.int32) for k in range(3))
    ids: NDArray[np.int32] = red | green << 8 | blue << 16
    return ids


def read_values(path: Path, error: type[LegoWorldError]) -> NDArray[np.uint8]:
    """(H, W) uint8 of a grey PNG, or the places of a PNG with a palette, as VOC's are."""
    expected = "an 8-bit PNG, grey or with a palette, whose values are category ids"
    return _read(path, ("L", "P"), error, expected)


def check_size(
    path: Path, pixels: NDArray[Any], size_hw: tuple[int, ...], error: type[LegoWorldError]
) -> None:
    """The error for a PNG of another size than it must have."""
    if pixels.shape != size_hw:
        raise error(
            f"{path.name} has another size than its image",
            found="{1}x{0}".format(*pixels.shape),
            expected="{1}x{0}".format(*size_hw),
        )


def _read(
    path: Path, modes: tuple[str, ...], error: type[LegoWorldError], expected: str
) -> NDArray[np.uint8]:
    try:
        with open_regular(path) as stream:
            data = stream.read()
        width, height = claimed_size_wh(data)
        if not data.startswith(PNG) or not 0 < width * height <= MOST_PHOTO_PX:
            raise ValueError(f"{width}x{height} pixels" if width else "no PNG")
        if not any(kind == b"IEND" for kind, _, _ in png_chunks(data)):
            raise ValueError("a PNG that is cut, or damaged")
        with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
            if picture.mode not in modes:
                raise ValueError(f"a PNG of mode {picture.mode}")
            return np.asarray(picture)
    except _UNREADABLE as problem:
        raise error(f"{path.name} cannot be read", found=cause(problem), expected=expected) from (
            problem
        )
