"""A photo as DA3's network reads it: the official preprocessing of one image, in plain steps."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

#: The official default of `process_res`, with `process_res_method` upper_bound_resize.
LONGEST_SIDE_PX = 504
PATCH_PX = 14
IMAGE_MEAN = (0.485, 0.456, 0.406)
IMAGE_STD = (0.229, 0.224, 0.225)


def network_photo(photo: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(3, h, w) float32 of a photo (H, W, 3) uint8 RGB; h and w are multiples of 14.

    Two resizes of 8-bit numbers, as officially: the longest side to 504, then each side to the
    nearest multiple of 14 (the larger one when halfway). Each is cubic when it enlarges anything
    and by area otherwise. Then x / 255 normalised with ImageNet's mean and deviation.
    """
    height, width = photo.shape[:2]
    scale = LONGEST_SIDE_PX / max(width, height)
    photo = _resized(photo, (max(1, round(width * scale)), max(1, round(height * scale))))
    height, width = photo.shape[:2]
    photo = _resized(photo, (_multiple(width), _multiple(height)))
    values = photo.astype(np.float32) / np.float32(255)
    values = (values - np.array(IMAGE_MEAN, np.float32)) / np.array(IMAGE_STD, np.float32)
    return np.ascontiguousarray(values.transpose(2, 0, 1))


def _resized(photo: NDArray[np.uint8], size_wh: tuple[int, int]) -> NDArray[np.uint8]:
    height, width = photo.shape[:2]
    if (width, height) == size_wh:
        return photo
    enlarges = size_wh[0] > width or size_wh[1] > height
    rule = cv2.INTER_CUBIC if enlarges else cv2.INTER_AREA
    return np.asarray(cv2.resize(photo, size_wh, interpolation=rule), np.uint8)


def _multiple(side_px: int) -> int:
    """The nearest positive multiple of 14, the larger one when halfway."""
    return max(PATCH_PX, (side_px + PATCH_PX // 2) // PATCH_PX * PATCH_PX)
