"""torchvision's detector trained on views of a scene: train_torchvision.py SCENE STEPS."""

from __future__ import annotations

import sys
from collections.abc import Iterable

import numpy as np
import torch
from torchvision.models.detection import MaskRCNN
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.backbone_utils import mobilenet_backbone

import legoworld


def picture(view: legoworld.SceneView) -> torch.Tensor:
    """(3, H, W) float32 in [0, 1]: surfaces lit from the camera; your own renders go here."""
    lit = np.nan_to_num(-view.normals()[..., 2], nan=0.0).clip(0, 1)
    return torch.from_numpy(np.repeat(lit[None], 3, axis=0))


def train(views: Iterable[legoworld.SceneView], steps: int) -> list[float]:
    """The loss of each step of a small Mask R-CNN from random weights; a view a step."""
    seen = [view for view in views if view.labelled]
    known = seen[0].vocabulary
    assert known is not None
    classes = max(category.id for category in known.categories) + 1  # 0 is the background
    backbone = mobilenet_backbone(
        backbone_name="mobilenet_v3_large", weights=None, fpn=True, trainable_layers=6
    )
    anchors = AnchorGenerator(((16, 32, 64, 128),) * 3, ((0.5, 1.0, 2.0),) * 3)
    model = MaskRCNN(
        backbone,
        num_classes=classes,
        rpn_anchor_generator=anchors,
        min_size=seen[0].size_wh[1],
    ).train()
    optimizer = torch.optim.SGD(model.parameters(), lr=0.01, momentum=0.9)
    losses = []
    for step in range(steps):
        view = seen[step % len(seen)]
        parts = model([picture(view)], [view.targets(image_id=step, arrays="torch")])
        loss = sum(parts.values())
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 5.0)
        optimizer.step()
        losses.append(loss.item())
    return losses


if __name__ == "__main__":
    torch.manual_seed(0)
    scene = legoworld.open_scene(sys.argv[1])
    around = np.repeat(scene.view(size_wh=(160, 120)).world_from_cam[None], 4, axis=0)
    around[:, 0, 3] += np.linspace(-0.05, 0.05, 4)
    made = scene.views(world_from_cam=around, size_wh=(160, 120), task="coco")
    print(*(f"{loss:.3f}" for loss in train(made, int(sys.argv[2]))))
