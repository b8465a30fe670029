"""The network: a normalised photo to 900 boxes with 91 class logits each."""

from __future__ import annotations

import torch
from dino_attention import image_positions
from dino_backbone import ResNetBody
from dino_transformer import DinoSize, Perceptron, Transformer, moved
from torch import Tensor, nn

_GROUPS = 32


class Dino(nn.Module):
    """DINO at inference. state_dict() has the original's names, less what `dino_checkpoint` drops.

    Denoising exists in training only, so the original's `label_enc` has no part here.
    """

    def __init__(self, size: DinoSize) -> None:
        super().__init__()
        self.dim = size.dim
        body = ResNetBody(size.backbone_blocks, size.backbone_width)
        self.backbone = nn.ModuleList([nn.ModuleDict({"body": body})])
        channels = [8 * size.backbone_width, 16 * size.backbone_width, 32 * size.backbone_width]
        projections = [_projection(nn.Conv2d(c, size.dim, 1)) for c in channels]
        inputs = channels[-1]
        for _ in range(size.levels - len(channels)):
            projections.append(_projection(nn.Conv2d(inputs, size.dim, 3, stride=2, padding=1)))
            inputs = size.dim
        self.input_proj = nn.ModuleList(projections)
        self.transformer = Transformer(size)
        layers = range(size.decoder_layers)
        self.class_embed = nn.ModuleList(nn.Linear(size.dim, size.classes) for _ in layers)
        self.bbox_embed = nn.ModuleList(Perceptron(size.dim, size.dim, size.dim, 4) for _ in layers)

    def forward(self, photo: Tensor) -> tuple[Tensor, Tensor]:
        """(3, H, W) normalised RGB to (Q, classes) logits and (Q, 4) boxes.

        Boxes are cx, cy, w, h as fractions of the photo. The last head reads the normed output
        and moves the boxes that the last layer started from: that is what "look forward twice"
        comes to at inference.
        """
        levels = self.levels(photo)
        shapes_hw = [(level.shape[-2], level.shape[-1]) for level in levels]
        features = torch.cat([level.flatten(1).T for level in levels])
        positions = torch.cat([image_positions(h, w, self.dim, features) for h, w in shapes_hw])
        memory = self.transformer.encode(features, positions, shapes_hw)
        boxes = self.transformer.select(memory, shapes_hw)
        output, boxes = self.transformer.decode(boxes, memory, shapes_hw, self.bbox_embed)
        return self.class_embed[-1](output), moved(boxes, self.bbox_embed[-1](output))

    def levels(self, photo: Tensor) -> list[Tensor]:
        """(3, H, W) to the (dim, h, w) maps at strides 8, 16, 32, 64, ..."""
        stages = self.backbone[0]["body"](photo[None])
        maps = []
        for index, project in enumerate(self.input_proj):
            if index < len(stages):
                source = stages[index]
            elif index == len(stages):
                source = stages[-1]
            else:
                source = maps[-1]
            maps.append(project(source))
        return [level[0] for level in maps]


def _projection(convolution: nn.Conv2d) -> nn.Sequential:
    return nn.Sequential(convolution, nn.GroupNorm(_GROUPS, convolution.out_channels))
