"""A network's array on the photo: left as it is, or read at the photo's pixels."""

from __future__ import annotations

import numpy as np
import torch
from legoworld_baseline.resampling import resized
from numpy.typing import NDArray

#: The scorer's own limit for an array whose aspect is not the photo's.
_ASPECT_TOLERANCE = 0.05


def written_array(
    values: NDArray[np.float32],
    space: str,
    photo_wh: tuple[int, int],
    padding_wh: tuple[int, int] = (0, 0),
) -> NDArray[np.float32]:
    """The network's (h, w) values as the run folder gets them.

    Left alone where they show the whole photo, in its aspect, and are no larger: the scorer reads
    them at the truth's pixels, bilinearly in 1 / z. Otherwise that is done here at the photo's
    size: pixel centres at .5, weights of neighbours without a prediction left out, none at all
    where these carry more than half.

    padding_wh: what the photo was padded with on each side, in its own pixels, before the network
    saw it. space: "depth" (holes become +inf) or "disparity" (holes become NaN).
    """
    if padding_wh == (0, 0) and fits(values.shape, photo_wh):
        return values
    (width, height), (left, top) = photo_wh, padding_wh
    found = resized(torch.from_numpy(values), space, (width + 2 * left, height + 2 * top))
    return np.ascontiguousarray(found[top : top + height, left : left + width].numpy())


def fits(shape_hw: tuple[int, ...], photo_wh: tuple[int, int]) -> bool:
    """Whether the scorer takes an array of this shape for a photo of this size."""
    height, width = shape_hw
    expected = photo_wh[1] * width / photo_wh[0]
    same_aspect = abs(height - expected) <= max(1.0, _ASPECT_TOLERANCE * expected)
    return same_aspect and width <= photo_wh[0] and height <= photo_wh[1]
