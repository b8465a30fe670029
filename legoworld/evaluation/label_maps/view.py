"""Small pictures of an image's label maps for the report."""

from __future__ import annotations

import base64
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.readouts.pictures import Rgb, png_bytes
from legoworld.records.label_maps import LabelMapView

LONGEST_SIDE: Final = 384
_LOSSLESS: Final = 101


def shown(pixels: NDArray[Any]) -> NDArray[Any]:
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
    """The view of three pictures. size_hw: of the image."""
    height, width = size_hw
    return LabelMapView(
        size_wh=(width, height),
        truth=_png(truth),
        answer=_png(answer),
        agreement=_png(agreement),
    )


def webp_of(png: str) -> bytes:
    """A picture of a view as the page holds it: lossless WebP."""
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), cv2.IMREAD_COLOR)
    done, data = cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, _LOSSLESS])
    assert done
    return data.tobytes()


def _png(picture: Rgb) -> str:
    return base64.b64encode(png_bytes(picture)).decode("ascii")
