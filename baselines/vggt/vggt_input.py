"""A photo as VGGT's network sees it, and where each of its pixels came from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Mode = Literal["crop", "pad"]

#: The official `target_size`, and the network's patches.
SIDE_PX = 518
PATCH_PX = 14
#: Four patches: what is smaller shows nothing to a network of patches.
LEAST_PX = 4 * PATCH_PX


class TooSmallError(ValueError):
    """A photo, or what the network would see of it, is less than a few patches wide or high."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """How a photo lies in the network's picture; sizes in pixels.

    resized_wh: of the photo when it is resized, each side apart; network_wh: of what the network
    sees; origin_xy: where the resized photo's upper left corner is in that, negative where it is
    cropped.
    """

    photo_wh: tuple[int, int]
    resized_wh: tuple[int, int]
    network_wh: tuple[int, int]
    origin_xy: tuple[int, int]


def fit(photo_wh: tuple[int, int], mode: Mode) -> Fit:
    """The official preprocessing's sizes (vggt/utils/load_fn.py). TooSmallError.

    The long side (crop: the width) becomes 518, the other one the nearest multiple of 14, so the
    scales of the two sides differ a little. crop then keeps the middle 518 rows; pad centres the
    photo in a white square.
    """
    width, height = photo_wh
    if mode == "crop" or width >= height:
        resized = SIDE_PX, round(height * (SIDE_PX / width) / PATCH_PX) * PATCH_PX
    else:
        resized = round(width * (SIDE_PX / height) / PATCH_PX) * PATCH_PX, SIDE_PX
    if min(*photo_wh, *resized) < LEAST_PX:
        raise TooSmallError(
            f"the photo is too small: {width}x{height} px, {resized[0]}x{resized[1]} to the "
            f"network, which needs {LEAST_PX} on each side"
        )
    network = (SIDE_PX, min(resized[1], SIDE_PX)) if mode == "crop" else (SIDE_PX, SIDE_PX)
    # All of them are multiples of 14, so the halves are whole.
    x, y = ((n - r) // 2 for n, r in zip(network, resized, strict=True))
    return Fit(photo_wh=photo_wh, resized_wh=resized, network_wh=network, origin_xy=(x, y))


def network_photo(photo: NDArray[np.uint8], placed: Fit) -> NDArray[np.float32]:
    """(3, h, w) float32 in [0, 1] of a photo (H, W, 3) uint8 RGB; the network normalises itself.

    A bicubic resize of 8-bit numbers by Pillow, as officially, then the crop or the white border.
    """
    resized = Image.fromarray(photo).resize(placed.resized_wh, Image.Resampling.BICUBIC)
    seen = np.ones((placed.network_wh[1], placed.network_wh[0], 3), np.float32)
    theirs, ours = windows(placed)
    seen[theirs] = np.asarray(resized, np.float32)[ours] / np.float32(255)
    return np.ascontiguousarray(seen.transpose(2, 0, 1))


def windows(placed: Fit) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The rows and columns of the network's picture that show the photo, and of the resized one."""
    theirs, ours = [], []
    for origin, seen, whole in zip(
        placed.origin_xy[::-1], placed.network_wh[::-1], placed.resized_wh[::-1], strict=True
    ):
        first, last = max(origin, 0), min(origin + whole, seen)
        theirs.append(slice(first, last))
        ours.append(slice(first - origin, last - origin))
    return (theirs[0], theirs[1]), (ours[0], ours[1])
