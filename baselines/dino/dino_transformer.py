"""Encoder, query selection and decoder of DINO, at inference, for one image.

Zhang et al., DINO: DETR with Improved DeNoising Anchor Boxes for End-to-End Object Detection,
ICLR 2023. Module and parameter names are those of the published checkpoints, whose decoder layers
number their norms by attribute, not by order: norm2 follows the self-attention, which comes first.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from dino_attention import DeformableAttention, box_positions, pixel_centres
from torch import Tensor, nn

_BASE_SIDE = 0.05  # side of the first level's proposals, as a fraction of the image
_BORDER = 0.01  # proposals with a coordinate nearer to 0 or 1 than this are out
_CLAMP = 1e-3  # logits are taken of fractions in 0.001 ... 0.999


@dataclass(frozen=True, kw_only=True)
class DinoSize:
    """How large the network is; the defaults are DINO-R50-4scale."""

    dim: int = 256
    heads: int = 8
    levels: int = 4
    points: int = 4
    encoder_layers: int = 6
    decoder_layers: int = 6
    feedforward: int = 2048
    queries: int = 900
    classes: int = 91
    backbone_blocks: tuple[int, int, int, int] = (3, 4, 6, 3)
    backbone_width: int = 64


class Perceptron(nn.Module):
    """Linear layers with ReLU between them."""

    def __init__(self, *dims: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(dims))

    def forward(self, x: Tensor) -> Tensor:
        """(..., first dim) to (..., last dim)."""
        for layer in self.layers[:-1]:
            x = layer(x).relu()
        return self.layers[-1](x)


class EncoderLayer(nn.Module):
    """Deformable self-attention over all levels' pixels, then a feed-forward block; post-norm."""

    def __init__(self, size: DinoSize) -> None:
        super().__init__()
        self.self_attn = DeformableAttention(size.dim, size.levels, size.heads, size.points)
        self.norm1 = nn.LayerNorm(size.dim)
        self.linear1 = nn.Linear(size.dim, size.feedforward)
        self.linear2 = nn.Linear(size.feedforward, size.dim)
        self.norm2 = nn.LayerNorm(size.dim)

    def forward(
        self, x: Tensor, positions: Tensor, centres: Tensor, shapes_hw: Sequence[tuple[int, int]]
    ) -> Tensor:
        """(S, dim) to (S, dim); positions (S, dim), centres (S, 2) of `pixel_centres`."""
        x = self.norm1(x + self.self_attn(x + positions, centres, x, shapes_hw))
        return self.norm2(x + self.linear2(self.linear1(x).relu()))


class DecoderLayer(nn.Module):
    """Self-attention of the queries, deformable attention into the image, feed-forward block."""

    def __init__(self, size: DinoSize) -> None:
        super().__init__()
        self.cross_attn = DeformableAttention(size.dim, size.levels, size.heads, size.points)
        self.norm1 = nn.LayerNorm(size.dim)
        self.self_attn = nn.MultiheadAttention(size.dim, size.heads)
        self.norm2 = nn.LayerNorm(size.dim)
        self.linear1 = nn.Linear(size.dim, size.feedforward)
        self.linear2 = nn.Linear(size.feedforward, size.dim)
        self.norm3 = nn.LayerNorm(size.dim)

    def forward(
        self,
        x: Tensor,
        positions: Tensor,
        boxes: Tensor,
        memory: Tensor,
        shapes_hw: Sequence[tuple[int, int]],
    ) -> Tensor:
        """(Q, dim) to (Q, dim); positions (Q, dim), boxes (Q, 4) cx, cy, w, h, memory (S, dim)."""
        placed = x + positions
        x = self.norm2(x + self.self_attn(placed, placed, x, need_weights=False)[0])
        x = self.norm1(x + self.cross_attn(x + positions, boxes, memory, shapes_hw))
        return self.norm3(x + self.linear2(self.linear1(x).relu()))


class Encoder(nn.Module):
    """The encoder layers."""

    def __init__(self, size: DinoSize) -> None:
        super().__init__()
        self.layers = nn.ModuleList(EncoderLayer(size) for _ in range(size.encoder_layers))


class Decoder(nn.Module):
    """The decoder layers, the norm of what they put out, and the embedding of boxes."""

    def __init__(self, size: DinoSize) -> None:
        super().__init__()
        self.layers = nn.ModuleList(DecoderLayer(size) for _ in range(size.decoder_layers))
        self.norm = nn.LayerNorm(size.dim)
        self.ref_point_head = Perceptron(2 * size.dim, size.dim, size.dim)


class Transformer(nn.Module):
    """Everything between the projected features and the heads of the decoder's layers."""

    def __init__(self, size: DinoSize) -> None:
        super().__init__()
        self.dim = size.dim
        self.level_embed = nn.Parameter(torch.zeros(size.levels, size.dim))
        self.encoder = Encoder(size)
        self.enc_output = nn.Linear(size.dim, size.dim)
        self.enc_output_norm = nn.LayerNorm(size.dim)
        self.enc_out_class_embed = nn.Linear(size.dim, size.classes)
        self.enc_out_bbox_embed = Perceptron(size.dim, size.dim, size.dim, 4)
        self.tgt_embed = nn.Embedding(size.queries, size.dim)
        self.decoder = Decoder(size)

    def encode(self, x: Tensor, positions: Tensor, shapes_hw: Sequence[tuple[int, int]]) -> Tensor:
        """(S, dim) features and their (S, dim) positions to the (S, dim) memory."""
        counts = [height * width for height, width in shapes_hw]
        levels = [e.expand(n, -1) for e, n in zip(self.level_embed, counts, strict=True)]
        positions = positions + torch.cat(levels)
        centres = pixel_centres(shapes_hw, x)
        for layer in self.encoder.layers:
            x = layer(x, positions, centres, shapes_hw)
        return x

    def select(self, memory: Tensor, shapes_hw: Sequence[tuple[int, int]]) -> Tensor:
        """(Q, 4) boxes of the pixels whose best class scores highest; one proposal a pixel."""
        logits, valid = proposals(shapes_hw, memory)
        features = memory.masked_fill(~valid, 0.0)
        features = self.enc_output_norm(self.enc_output(features))
        best = self.enc_out_class_embed(features).amax(-1)
        chosen = best.topk(self.tgt_embed.num_embeddings).indices
        return (self.enc_out_bbox_embed(features[chosen]) + logits[chosen]).sigmoid()

    def decode(
        self,
        boxes: Tensor,
        memory: Tensor,
        shapes_hw: Sequence[tuple[int, int]],
        box_heads: nn.ModuleList,
    ) -> tuple[Tensor, Tensor]:
        """(Q, dim) normed output of the last layer, and the (Q, 4) boxes that layer started from.

        Between layers, boxes move by the head's reading of the layer's output BEFORE the norm.
        """
        x = self.tgt_embed.weight
        for index, layer in enumerate(self.decoder.layers):
            if index:
                boxes = moved(boxes, box_heads[index - 1](x))
            positions = self.decoder.ref_point_head(box_positions(boxes, self.dim))
            x = layer(x, positions, boxes, memory, shapes_hw)
        return self.decoder.norm(x), boxes


def proposals(shapes_hw: Sequence[tuple[int, int]], like: Tensor) -> tuple[Tensor, Tensor]:
    """(S, 4) logits of a square box at every pixel, 0.05 * 2^level wide; (S, 1) bool: is it in.

    Logits are +inf where a coordinate is not inside 0.01 ... 0.99.
    """
    sides = [
        torch.full((height * width, 2), _BASE_SIDE * 2.0**level, dtype=like.dtype)
        for level, (height, width) in enumerate(shapes_hw)
    ]
    boxes = torch.cat((pixel_centres(shapes_hw, like), torch.cat(sides).to(like.device)), -1)
    valid = ((boxes > _BORDER) & (boxes < 1 - _BORDER)).all(-1, keepdim=True)
    return (boxes / (1 - boxes)).log().masked_fill(~valid, torch.inf), valid


def moved(boxes: Tensor, delta: Tensor) -> Tensor:
    """(Q, 4) boxes, moved by (Q, 4) deltas of their logits."""
    boxes = boxes.clamp(0, 1)
    logits = (boxes.clamp(min=_CLAMP) / (1 - boxes).clamp(min=_CLAMP)).log()
    return (logits + delta).sigmoid()
