"""A photo as the network's input, and the network's classes at the photo's size."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pycocotools import mask as coco_mask

#: The middle of the input's range, which the network reads as 0.
GREY = 127


def prepared(
    photo: NDArray[np.uint8], side: int, how: str
) -> tuple[NDArray[np.uint8], tuple[int, int]]:
    """(side, side, 3) uint8, and the (height, width) of it that shows the photo."""
    height, width = photo.shape[:2]
    shown = (side, side)
    if how == "pad":
        scale = side / max(height, width)
        shown = max(1, round(height * scale)), max(1, round(width * scale))
    pixels = np.full((side, side, 3), GREY, np.uint8)
    resized = Image.fromarray(photo).resize(shown[::-1], Image.Resampling.BILINEAR)
    pixels[: shown[0], : shown[1]] = np.asarray(resized)
    return pixels, shown


def at_photo_size(
    classes: NDArray[Any], shown: tuple[int, int], size_wh: tuple[int, int]
) -> NDArray[np.uint8]:
    """(height, width) uint8: the nearest class of each pixel, the padding cut off."""
    part = Image.fromarray(classes[: shown[0], : shown[1]].astype(np.uint8))
    return np.asarray(part.resize(size_wh, Image.Resampling.NEAREST))


def entries(classes: NDArray[np.uint8], category_ids: set[int]) -> list[dict[str, Any]]:
    """A mask of each class that is there, by id."""
    found = []
    for number in sorted({*np.unique(classes).tolist()} & category_ids):
        encoded: Any = coco_mask.encode(np.asfortranarray(classes == number, np.uint8))
        rle = {"size": list(map(int, encoded["size"])), "counts": encoded["counts"].decode("ascii")}
        found.append({"category_id": int(number), "segmentation": rle})
    return found
