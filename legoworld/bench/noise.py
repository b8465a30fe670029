"""The noise floor of A: how the render card's seed moves A of a reference rendered as itself."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from legoworld.evaluation.reconstruction.appearance import agreement, decode_picture, resize_picture
from legoworld.records.bench_dataset import NoiseFloor


def noise_floor(
    seeds: tuple[int, ...], renders: Sequence[bytes], picture: bytes, delta: int
) -> NoiseFloor:
    """A of each render against the reference picture, and their standard deviation (ddof = 1).

    renders: one PNG a seed; sd is 0 for a single seed, which says nothing of noise.
    """
    reference = decode_picture(picture)
    shares = []
    for png in renders:
        render = decode_picture(png)
        size_wh = (render.shape[1], render.shape[0])
        shares.append(agreement(render, resize_picture(reference, size_wh)).share(delta))
    sd = statistics.stdev(shares) if len(shares) > 1 else 0.0
    return NoiseFloor(seeds=seeds, a_self=tuple(shares), sd=sd)
