"""PNGs of numbers: ids as colours, or categories as grey values or places of a palette.

And the small pictures of an image's label maps for the report.
"""

from __future__ import annotations

import base64
import io
import struct
import zlib
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from legoworld.errors import LegoWorldError, cause
from legoworld.files import open_regular
from legoworld.readouts.pictures import Rgb, png_bytes
from legoworld.records.label_maps import LabelMapView
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
    """The error for a PNG of another size than it must have. pixels: (H, W)."""
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


LONGEST_SIDE: Final = 384
_LOSSLESS: Final = 101


def shrink_map(pixels: NDArray[Any]) -> NDArray[Any]:
    """The pixels of a small view: the middle one of each block, at most 384 blocks a side."""
    height, width = pixels.shape[:2]
    shrink = max(1.0, max(width, height) / LONGEST_SIDE)
    high, wide = max(1, int(height / shrink)), max(1, int(width / shrink))
    rows = (2 * np.arange(high) + 1) * height // (2 * high)
    cols = (2 * np.arange(wide) + 1) * width // (2 * wide)
    return np.ascontiguousarray(pixels[rows][:, cols])


def label_map_view(
    size_hw: tuple[int, ...], *, truth: Rgb, answer: Rgb, agreement: Rgb
) -> LabelMapView:
    """The view of three (h, w, 3) uint8 pictures, small or whole. size_hw: of the image."""
    height, width = size_hw
    return LabelMapView(
        size_wh=(width, height), truth=_png(truth), answer=_png(answer), agreement=_png(agreement)
    )


def view_picture(png: str) -> Rgb:
    """(H, W, 3) of a picture of a view."""
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), cv2.IMREAD_COLOR_RGB)
    return np.asarray(pixels, np.uint8)


def encode_webp(picture: Rgb) -> bytes:
    """A (H, W, 3) picture as the page holds it: lossless WebP."""
    pixels = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, _LOSSLESS])
    assert done
    return data.tobytes()


def _png(picture: Rgb) -> str:
    return base64.b64encode(png_bytes(picture)).decode("ascii")
