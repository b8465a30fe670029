"""Cameras out of (B, S, 9): translation, quaternion (x, y, z, w), vertical and horizontal field."""

from __future__ import annotations

import torch


def pose_encoding_to_extri_intri(
    pose_encoding, image_size_hw=None, pose_encoding_type="absT_quaR_FoV", build_intrinsics=True
):
    """(B, S, 3, 4) camera from world and (B, S, 3, 3) intrinsics in pixels of (H, W)."""
    if pose_encoding_type != "absT_quaR_FoV":
        raise NotImplementedError
    x, y, z, w = torch.nn.functional.normalize(pose_encoding[..., 3:7], dim=-1).unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    rotation = torch.eye(3) + 2 * w[..., None, None] * cross + 2 * cross @ cross
    extrinsics = torch.cat([rotation, pose_encoding[..., :3, None]], dim=-1)
    if not build_intrinsics:
        return extrinsics, None
    intrinsics = torch.zeros(*x.shape, 3, 3)
    for axis, field in ((0, 8), (1, 7)):
        half = image_size_hw[1 - axis] / 2
        intrinsics[..., axis, axis] = half / torch.tan(pose_encoding[..., field] / 2)
        intrinsics[..., axis, 2] = half
    intrinsics[..., 2, 2] = 1
    return extrinsics, intrinsics
