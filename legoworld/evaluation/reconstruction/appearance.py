"""A: the evaluator's own render held to the reference picture, pixel by pixel."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from legoworld.errors import cause
from legoworld.evaluation.reconstruction.points import Flags
from legoworld.scene.pictures import MOST_PHOTO_PX, claimed_size_wh

Picture = NDArray[np.uint8]
#: Largest channel differences at which A's curve is read, besides the card's delta.
CURVE: Final = (0, 5, 10, 15, 20, 25, 30, 40, 50, 60, 80, 100)
#: Pillow's names of what `claimed_size_wh` knows.
_FORMATS: Final = ("PNG", "JPEG", "WEBP", "BMP")


class PictureError(ValueError):
    """A picture cannot be decoded; the text says why."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """largest: (H, W) uint8, of the three channels' absolute differences the largest."""

    largest: Picture

    def hits(self, delta: int) -> Flags:
        """(H, W) pixels that count for A."""
        return self.largest <= delta

    def share(self, delta: int) -> float:
        """A at a delta."""
        return float(np.count_nonzero(self.hits(delta))) / self.largest.size


def decode_picture(data: bytes) -> Picture:
    """A picture file as (H, W, 3) 8-bit sRGB, alpha dropped. PictureError."""
    width, height = claimed_size_wh(data)
    if width * height > MOST_PHOTO_PX:
        raise PictureError(f"{width}x{height} pixels, more than {MOST_PHOTO_PX:,}")
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as opened:
            return np.asarray(opened.convert("RGB"))
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise PictureError(cause(error)) from error


def resize_picture(picture: Picture, size_wh: tuple[int, int]) -> Picture:
    """(H, W, 3) by Pillow's LANCZOS, as the published evaluator's; itself where sizes are equal."""
    height, width = picture.shape[:2]
    if (width, height) == size_wh:
        return picture
    return np.asarray(Image.fromarray(picture).resize(size_wh, Image.Resampling.LANCZOS))


def agreement(render: Picture, reference: Picture) -> Agreement:
    """Of two (H, W, 3) pictures of one size."""
    assert render.shape == reference.shape
    apart = np.maximum(render, reference) - np.minimum(render, reference)
    return Agreement(largest=np.maximum(np.maximum(apart[..., 0], apart[..., 1]), apart[..., 2]))


def curve(agreement: Agreement, delta: int) -> dict[str, float]:
    """A by delta, ascending; never falls."""
    counts = np.cumsum(np.bincount(agreement.largest.ravel(), minlength=256))
    return {str(d): float(counts[d]) / agreement.largest.size for d in sorted({*CURVE, delta})}


def raster_indices(
    shape: tuple[int, ...], raster_shape: tuple[int, ...]
) -> tuple[NDArray[np.intp], ...]:
    """(H, 1) rows and (1, W) columns, to index with, of the raster pixel around each pixel."""
    (height, width), (raster_height, raster_width) = shape, raster_shape
    rows = ((np.arange(height) + 0.5) * raster_height / height).astype(np.intp)
    columns = ((np.arange(width) + 0.5) * raster_width / width).astype(np.intp)
    return np.ix_(rows, columns)
