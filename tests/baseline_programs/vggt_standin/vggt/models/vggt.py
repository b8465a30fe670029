"""`VGGT` by its interface: pictures in [0, 1] to poses, depth and confidence."""

from __future__ import annotations

import torch
from torch import nn


class Aggregator(nn.Module):
    """Tokens of patches; the mean and deviation are no part of a checkpoint, as in the real one."""

    def __init__(self, img_size, patch_size, embed_dim):
        super().__init__()
        assert img_size % patch_size == 0
        self.patch_embed = nn.Conv2d(3, 2 * embed_dim, patch_size, patch_size)
        self.camera_token = nn.Parameter(torch.zeros(1, 2, 1, embed_dim))
        self.register_buffer("_resnet_mean", torch.full((1, 3, 1, 1), 0.45), persistent=False)

    def forward(self, images):
        tokens = self.patch_embed(images.flatten(0, 1) - self._resnet_mean)
        return [tokens.unflatten(0, images.shape[:2])], 5


class CameraHead(nn.Module):
    """Nine numbers a view; the fields of view are rectified, as in the real one."""

    def __init__(self, dim_in):
        super().__init__()
        self.pose_branch = nn.Linear(dim_in, 9)

    def forward(self, aggregated_tokens_list, num_iterations=4):
        pose = self.pose_branch(aggregated_tokens_list[-1].float().mean((-2, -1)))
        pose = torch.cat([pose[..., :7], pose[..., 7:].relu()], -1)
        return [pose] * num_iterations


class DPTHead(nn.Module):
    """`exp` of a depth and 1 + `exp` of a confidence for each pixel."""

    def __init__(self, dim_in, output_dim):
        super().__init__()
        self.scratch = nn.Conv2d(dim_in, output_dim, 1)

    def forward(self, aggregated_tokens_list, images, patch_start_idx):
        assert patch_start_idx == 5
        made = self.scratch(aggregated_tokens_list[-1].float().flatten(0, 1))
        made = nn.functional.interpolate(made, images.shape[-2:], mode="bilinear")
        made = made.unflatten(0, images.shape[:2]).movedim(2, -1)
        return made[..., :-1].exp(), 1 + made[..., -1].exp()


class VGGT(nn.Module):
    """The real one's arguments; a head that is not enabled is None."""

    def __init__(
        self, img_size=518, patch_size=14, embed_dim=1024,
        enable_camera=True, enable_point=True, enable_depth=True, enable_track=True,
    ):  # fmt: skip
        super().__init__()
        self.aggregator = Aggregator(img_size, patch_size, embed_dim)
        self.camera_head = CameraHead(2 * embed_dim) if enable_camera else None
        self.point_head = DPTHead(2 * embed_dim, 4) if enable_point else None
        self.depth_head = DPTHead(2 * embed_dim, 2) if enable_depth else None
        self.track_head = nn.Linear(2 * embed_dim, 3) if enable_track else None

    def forward(self, images, query_points=None):
        assert query_points is None, "tracks of points are not stood in for"
        if images.ndim == 4:
            images = images[None]
        tokens, patch_start_idx = self.aggregator(images)
        predictions = {}
        with torch.autocast("cuda", enabled=False):
            if self.camera_head is not None:
                predictions["pose_enc"] = self.camera_head(tokens)[-1]
            for name, head in (("depth", self.depth_head), ("world_points", self.point_head)):
                if head is not None:
                    values, confidence = head(tokens, images, patch_start_idx)
                    predictions |= {name: values, f"{name}_conf": confidence}
        predictions["images"] = images
        return predictions
