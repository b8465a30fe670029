"""What the depth of the sky is: the network's own guess, a far value, or nothing at all."""

from __future__ import annotations

from typing import Literal, get_args

import torch

Policy = Literal["seeded", "mask", "off"]
POLICIES: tuple[Policy, ...] = get_args(Policy)

#: The official numbers: what counts as sky, and what it is set to.
SKY_THRESHOLD = 0.3
FAR_QUANTILE = 0.99
SAMPLE_SIZE = 100_000
#: Pictures with as few pixels of sky, or of anything else, are left as they are, as officially.
MIN_PIXELS = 10


def without_sky(
    depth: torch.Tensor, sky: torch.Tensor, policy: Policy, seed: int
) -> tuple[torch.Tensor, int]:
    """Depth (h, w) with the policy applied where sky (h, w) >= 0.3, and how many pixels that is.

    seeded: those pixels get the 0.99 quantile of the others' depth, like the official code, which
    takes it from 100,000 of them drawn with replacement by a generator nobody seeds; here they
    are drawn on the CPU with `seed`, anew for every image, so that neither the order of the
    images nor the device changes a byte. mask: those pixels are +inf, no prediction. off: nothing
    is changed and the count is 0.
    """
    is_sky = ~(sky < SKY_THRESHOLD)
    n_sky = int(is_sky.sum())
    n_rest = is_sky.numel() - n_sky
    if policy == "off" or n_sky <= MIN_PIXELS or n_rest <= MIN_PIXELS:
        return depth, 0
    far = torch.inf if policy == "mask" else _far(depth[~is_sky], seed)
    return torch.where(is_sky, torch.as_tensor(far, dtype=depth.dtype), depth), n_sky


def _far(depths: torch.Tensor, seed: int) -> torch.Tensor:
    if depths.numel() > SAMPLE_SIZE:
        generator = torch.Generator().manual_seed(seed)
        depths = depths[torch.randint(depths.numel(), (SAMPLE_SIZE,), generator=generator)]
    return torch.quantile(depths, FAR_QUANTILE)
