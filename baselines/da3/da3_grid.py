"""The size of the array that is written."""

from __future__ import annotations

import numpy as np
import torch
from legoworld_baseline.resampling import resized
from numpy.typing import NDArray


def written_array(depth: NDArray[np.float32], photo_wh: tuple[int, int]) -> NDArray[np.float32]:
    """Depth (h, w) as the run folder gets it: the network's own array, unless that is too large.

    The scorer reads a smaller array at the truth's pixels itself, bilinearly in 1 / z, so the
    array is left as the network made it (504 x 336 instead of 6048 x 4032: no interpolation
    twice). It accepts none that is larger than the photo in either direction: such a one is read
    at the photo's pixel centres by the same rule, with +inf where the pixels without prediction
    carry more than half of the weight.
    """
    width, height = photo_wh
    if depth.shape[1] <= width and depth.shape[0] <= height:
        return depth
    return resized(torch.from_numpy(depth), "depth", photo_wh).numpy()
