"""Depth estimators of transformers without torchvision: input, forward pass, numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers
from legoworld_baseline import Refused
from legoworld_baseline.hugging_face import load_pretrained, read_config
from legoworld_baseline.image_processors import description, load_processor, processor_record
from legoworld_baseline.model_kinds import wrong_kind
from numpy.typing import NDArray
from PIL import Image
from torch.nn import functional


@dataclass(frozen=True, kw_only=True)
class Preparation:
    """How a photo becomes a network's input.

    pixel_values: (H, W, 3) uint8 to (1, 3, h, w); mirrored: ZoeDepth's border, see `padding_wh`;
    record: for provenance.
    """

    pixel_values: Callable[[NDArray[np.uint8]], torch.Tensor]
    mirrored: bool
    record: dict[str, Any]


def load_config(folder: Path) -> Any:
    """The model's configuration. Refused when it is no depth estimator."""
    config = read_config(folder)
    if type(config) not in transformers.AutoModelForDepthEstimation._model_mapping:
        raise wrong_kind(
            "this model does not estimate depth",
            config,
            expected="a model of transformers.AutoModelForDepthEstimation",
        )
    return config


def load_network(folder: Path, device: str, dtype: str) -> Any:
    """The network with every parameter out of the checkpoint. Refused otherwise."""
    return load_pretrained(
        transformers.AutoModelForDepthEstimation, folder, device=device, dtype=dtype
    )


def load_preparation(folder: Path, model_type: str, backend: str) -> Preparation:
    """From a photo (H, W, 3) to pixel_values (1, 3, h, w) as the checkpoint describes it.

    backend: of the image processor, "pil" or "torchvision". Refused when the description is
    absent, needs the other backend, or shows less or more of the photo than the whole (cropped, or
    padded in a way that is not undone here).
    """
    if model_type == "depth_pro":
        return _depth_pro_preparation(description(folder))
    processor = load_processor(folder, backend)
    mirrored = model_type == "zoedepth" and bool(processor.do_pad)
    padded = getattr(processor, "do_pad", False) and not mirrored
    if padded or getattr(processor, "do_center_crop", False):
        raise Refused(
            "the preprocessing pads or crops the photo",
            found="do_pad" if padded else "do_center_crop",
            expected="preprocessing that only resizes",
            next_step="choose another model, or pass its results to `legoworld baseline import`",
        )

    def prepare(photo: NDArray[np.uint8]) -> torch.Tensor:
        pixels: torch.Tensor = processor(
            images=Image.fromarray(photo), return_tensors="pt"
        ).pixel_values
        return pixels

    return Preparation(pixel_values=prepare, mirrored=mirrored, record=processor_record(processor))


def padding_wh(preparation: Preparation, photo_wh: tuple[int, int]) -> tuple[int, int]:
    """How far ZoeDepth's processor mirrors the photo beyond each side, in photo pixels."""
    if not preparation.mirrored:
        return 0, 0
    width, height = (int(math.sqrt(side / 2) * 3) for side in photo_wh)
    return width, height


@torch.inference_mode()
def predicted_depth(network: Any, pixel_values: torch.Tensor) -> NDArray[np.float32]:
    """The network's numbers (h, w), float32. ValueError when one is not finite.

    Depth Pro gives inverse depth for a field of view of its own; with its estimate of the field
    of view this becomes 1 / m, and then m within 0.1 mm and 10 km, as its authors do.
    """
    out = network(pixel_values=pixel_values.to(network.device, network.dtype))
    values = out.predicted_depth[0].float().cpu()
    if network.config.model_type == "depth_pro":
        half_view = 0.5 * torch.deg2rad(out.field_of_view[0].float().cpu())
        values = 1.0 / (values * 2.0 * torch.tan(half_view)).clamp(1e-4, 1e4)
    if values.ndim != 2 or not torch.isfinite(values).all():
        raise ValueError("the network's depth is not finite (with float16, try float32)")
    return values.numpy()


def check_metric(config: Any) -> None:
    """Refused when Depth Pro has no estimate of the field of view: its depth has no scale."""
    if config.model_type == "depth_pro" and not config.use_fov_model:
        raise Refused(
            "this Depth Pro does not estimate the field of view",
            found="use_fov_model false",
            expected="use_fov_model true: without it the depth is not in metres",
        )


def _depth_pro_preparation(described: dict[str, Any]) -> Preparation:
    """Depth Pro's processor exists for torchvision only: normalise, then resize unfiltered."""
    expected = {"resample": 2, "do_resize": True, "do_rescale": True, "do_normalize": True}
    for name, value in expected.items():
        if described.get(name, value) != value:
            raise Refused(
                "this Depth Pro checkpoint has another preprocessing",
                found=f"{name} {described[name]}",
                expected=str(value),
                next_step="use a Depth Pro checkpoint with the published preprocessing",
            )
    size = described["size"]["height"], described["size"]["width"]
    mean, std = (
        torch.tensor(described[name]).view(1, 3, 1, 1) for name in ("image_mean", "image_std")
    )

    def prepare(photo: NDArray[np.uint8]) -> torch.Tensor:
        values = torch.from_numpy(photo.transpose(2, 0, 1).astype(np.float32))[None] / 255.0
        return functional.interpolate(
            (values - mean) / std, size=size, mode="bilinear", align_corners=False
        )

    record = {"class": None, "backend": "torch", "settings": described}
    return Preparation(pixel_values=prepare, mirrored=False, record=record)
