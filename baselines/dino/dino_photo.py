"""A photo as the network was trained to see it: resized as Pillow resizes, normalised."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

SHORT_SIDE_PX = 800
LONG_SIDE_PX = 1333
MEAN_RGB = (0.485, 0.456, 0.406)
STD_RGB = (0.229, 0.224, 0.225)


def resized_wh(width: int, height: int) -> tuple[int, int]:
    """(width, height) with the short side at 800, or less where the long one would pass 1333.

    The published rule: the short side is rounded to even on ties, the long side is cut down.
    """
    short, long = min(width, height), max(width, height)
    target = SHORT_SIDE_PX
    if long / short * target > LONG_SIDE_PX:
        target = round(LONG_SIDE_PX * short / long)
    if short == target:
        return width, height
    if width < height:
        return target, int(target * height / width)
    return int(target * width / height), target


def normalised(rgb: NDArray[np.uint8]) -> Tensor:
    """(H, W, 3) uint8 RGB to the (3, h, w) float32 that the network takes."""
    size_wh = resized_wh(rgb.shape[1], rgb.shape[0])
    resized = np.asarray(Image.fromarray(rgb).resize(size_wh, Image.Resampling.BILINEAR))
    pixels = torch.from_numpy(resized.copy()).permute(2, 0, 1).float() / 255
    mean, std = torch.tensor(MEAN_RGB), torch.tensor(STD_RGB)
    return (pixels - mean[:, None, None]) / std[:, None, None]
