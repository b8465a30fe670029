"""Sine position encodings and multi-scale deformable attention, for one image and no padding.

Zhu et al., Deformable DETR, ICLR 2021 (the attention, eq. 3); Liu et al., DAB-DETR, ICLR 2022
(boxes encoded as sines). Tensors carry no batch axis. A "level" is one feature map; all levels'
pixels stand one after another, row by row, in one sequence of length S.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

IMAGE_TEMPERATURE = 20
BOX_TEMPERATURE = 10000
_EPSILON = 1e-6  # in the divisor of the normalised pixel index, as published


def image_positions(height: int, width: int, dim: int, like: Tensor) -> Tensor:
    """(height * width, dim) sines of the pixel index, y in the first half, x in the second.

    Row i of H stands at 2 pi (i + 1) / (H + 1e-6): the count from one, no half-pixel offset.
    """
    halves = []
    for size in (height, width):
        count = torch.arange(1, size + 1, dtype=like.dtype, device=like.device)
        halves.append(_sines(count / (size + _EPSILON), dim // 2, IMAGE_TEMPERATURE))
    y = halves[0][:, None].expand(height, width, dim // 2)
    x = halves[1][None, :].expand(height, width, dim // 2)
    return torch.cat((y, x), -1).reshape(height * width, dim)


def box_positions(boxes_cxcywh: Tensor, dim: int) -> Tensor:
    """(Q, 4) boxes as fractions of the image to (Q, 2 dim) sines of cy, cx, w and h."""
    parts = [_sines(boxes_cxcywh[:, axis], dim // 2, BOX_TEMPERATURE) for axis in (1, 0, 2, 3)]
    return torch.cat(parts, -1)


def _sines(fraction: Tensor, dim: int, temperature: float) -> Tensor:
    """(...) to (..., dim): sin and cos in turn, of 2 pi fraction / temperature^(2 k / dim)."""
    index = torch.arange(dim, dtype=fraction.dtype, device=fraction.device)
    period = temperature ** (2 * (index // 2) / dim)
    angle = (fraction * (2 * math.pi))[..., None] / period
    return torch.stack((angle[..., 0::2].sin(), angle[..., 1::2].cos()), -1).flatten(-2)


def pixel_centres(shapes_hw: Sequence[tuple[int, int]], like: Tensor) -> Tensor:
    """(S, 2) x, y of every pixel centre of every level, as fractions of the image."""
    levels = []
    for height, width in shapes_hw:
        rows = torch.linspace(0.5, height - 0.5, height, dtype=like.dtype, device=like.device)
        columns = torch.linspace(0.5, width - 0.5, width, dtype=like.dtype, device=like.device)
        y, x = torch.meshgrid(rows / height, columns / width, indexing="ij")
        levels.append(torch.stack((x.flatten(), y.flatten()), -1))
    return torch.cat(levels)


class DeformableAttention(nn.Module):
    """Each query reads a few points a level, at learnt offsets from where it stands."""

    def __init__(self, dim: int, levels: int, heads: int, points: int) -> None:
        super().__init__()
        self.levels, self.heads, self.points = levels, heads, points
        self.sampling_offsets = nn.Linear(dim, heads * levels * points * 2)
        self.attention_weights = nn.Linear(dim, heads * levels * points)
        self.value_proj = nn.Linear(dim, dim)
        self.output_proj = nn.Linear(dim, dim)

    def forward(
        self,
        queries: Tensor,
        references: Tensor,
        features: Tensor,
        shapes_hw: Sequence[tuple[int, int]],
    ) -> Tensor:
        """(Q, dim) out of (S, dim) features.

        references: (Q, 2) points or (Q, 4) boxes cx, cy, w, h, fractions of the image. Offsets
        are in pixels of their level for points, and in units of w / (2 points), h / (2 points)
        for boxes. Values are read bilinearly at pixel centres and are 0 outside the map.
        """
        split = (self.heads, self.levels, self.points)
        values = self.value_proj(features).unflatten(-1, (self.heads, -1))
        offsets = self.sampling_offsets(queries).unflatten(-1, (*split, 2))
        weights = self.attention_weights(queries).unflatten(-1, (self.heads, -1)).softmax(-1)
        weights = weights.unflatten(-1, split[1:])
        total = queries.new_zeros(())
        per_level = values.split([height * width for height, width in shapes_hw])
        for level, (height, width) in enumerate(shapes_hw):
            if references.shape[-1] == 2:
                reach = offsets[:, :, level] / queries.new_tensor((width, height))
            else:
                reach = offsets[:, :, level] / self.points * references[:, None, None, 2:] * 0.5
            at = references[:, None, None, :2] + reach
            # (heads, channels, height, width) read at (heads, Q, points)
            maps = per_level[level].permute(1, 2, 0).unflatten(-1, (height, width))
            read = functional.grid_sample(
                maps,
                2 * at.transpose(0, 1) - 1,
                mode="bilinear",
                padding_mode="zeros",
                align_corners=False,
            )
            total = total + (read * weights[:, :, level].transpose(0, 1)[:, None]).sum(-1)
        return self.output_proj(total.flatten(0, 1).transpose(0, 1))
