"""VGGT's depth on the photo's grid: unknown where the network saw nothing, or was not sure."""

from __future__ import annotations

import numpy as np
import torch
from legoworld_baseline.resampling import resized
from numpy.typing import NDArray
from vggt_input import Fit, windows


def photo_depth(
    depth: NDArray[np.float32],
    confidence: NDArray[np.float32],
    placed: Fit,
    least_confidence: float,
) -> NDArray[np.float32]:
    """Depth (h, w) float32 over the whole photo; +inf where there is no prediction.

    depth, confidence: (h, w) of the network's picture. The array is as large as the resized photo;
    one that would be larger than the photo is read at the photo's pixel centres by the scorer's
    rule, as it accepts none that is larger.
    """
    values = np.full(placed.resized_wh[::-1], np.inf, np.float32)
    theirs, ours = windows(placed)
    sure = confidence[theirs] >= least_confidence
    values[ours] = np.where(sure, depth[theirs], np.float32(np.inf))
    (width, height), (wide, high) = placed.photo_wh, placed.resized_wh
    if wide <= width and high <= height:
        return values
    return resized(torch.from_numpy(values), "depth", placed.photo_wh).numpy()
