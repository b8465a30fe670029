"""Depth read at another size by the scorer's own rule: bilinear in 1 / z, holes left out."""

from __future__ import annotations

import torch
from torch.nn import functional


def resized(values: torch.Tensor, space: str, size_wh: tuple[int, int]) -> torch.Tensor:
    """Values (h, w) at the pixel centres of an image of `size_wh`.

    space: "depth" (no prediction: not finite or not above 0; holes become +inf) or "disparity"
    (not finite; holes become NaN). Neighbours without a prediction carry no weight; where they
    would carry more than half, there is no prediction.
    """
    seen = torch.isfinite(values)
    if space == "depth":
        seen &= values > 0
    disparity = torch.where(seen, values if space == "disparity" else 1.0 / values, 0.0)
    planes = torch.stack([disparity, seen.to(values.dtype)])[None]
    found = functional.interpolate(
        planes, size=size_wh[::-1], mode="bilinear", align_corners=False
    )[0]
    predicted = found[1] >= 0.5
    if space == "disparity":
        return torch.where(predicted, found[0] / found[1], torch.nan)
    return torch.where(predicted, found[1] / found[0], torch.inf)
