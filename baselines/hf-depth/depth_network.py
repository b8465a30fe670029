"""Depth estimators of transformers without torchvision: input, forward pass, numbers."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers
from legoworld_baseline import Refused
from legoworld_baseline.hugging_face import load_pretrained, read_config
from numpy.typing import NDArray
from PIL import Image
from torch.nn import functional

Prepare = Callable[[NDArray[np.uint8]], torch.Tensor]


def load_config(folder: Path) -> Any:
    """The model's configuration. Refused when it is no depth estimator."""
    config = read_config(folder)
    if type(config) not in transformers.AutoModelForDepthEstimation._model_mapping:
        raise Refused(
            "this model does not estimate depth",
            found=f"model_type {config.model_type!r}",
            expected="a model of transformers.AutoModelForDepthEstimation",
        )
    return config


def load_network(folder: Path, device: str, dtype: str) -> Any:
    """The network with every parameter out of the checkpoint. Refused otherwise."""
    return load_pretrained(
        transformers.AutoModelForDepthEstimation, folder, device=device, dtype=dtype
    )


def load_preparation(folder: Path, model_type: str) -> Prepare:
    """From a photo (H, W, 3) to pixel_values (1, 3, h, w) as the checkpoint describes it.

    Refused when the description is absent, needs torchvision, or shows less or more of the photo
    than the whole (cropped, or padded in a way that is not undone here).
    """
    path = folder / "preprocessor_config.json"
    if not path.is_file():
        raise Refused("the checkpoint does not describe its input", expected=path.name)
    described = json.loads(path.read_text(encoding="utf-8"))
    if model_type == "depth_pro":
        return _depth_pro_preparation(described)
    try:
        processor = transformers.AutoImageProcessor.from_pretrained(folder, local_files_only=True)
    except ImportError as error:
        raise Refused(
            "this model's image processor needs torchvision, which is not used here",
            found=" ".join(str(error).split())[:200],
            expected="a processor that works with Pillow",
        ) from error
    padded = getattr(processor, "do_pad", False) and model_type != "zoedepth"
    if padded or getattr(processor, "do_center_crop", False):
        raise Refused(
            "the network would not see exactly the whole photo",
            found="do_pad" if padded else "do_center_crop",
            expected="an input that is only resized",
        )
    return lambda photo: processor(images=Image.fromarray(photo), return_tensors="pt").pixel_values


def padding_wh(folder: Path, model_type: str, photo_wh: tuple[int, int]) -> tuple[int, int]:
    """How far ZoeDepth's processor mirrors the photo beyond each side, in photo pixels."""
    described = json.loads((folder / "preprocessor_config.json").read_text(encoding="utf-8"))
    if model_type != "zoedepth" or not described.get("do_pad", True):
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
            expected="use_fov_model true: without it its numbers are no metres",
        )


def _depth_pro_preparation(described: dict[str, Any]) -> Prepare:
    """Depth Pro's processor exists for torchvision only: normalise, then resize unfiltered."""
    expected = {"resample": 2, "do_resize": True, "do_rescale": True, "do_normalize": True}
    for name, value in expected.items():
        if described.get(name, value) != value:
            raise Refused(
                "a Depth Pro with another preprocessing",
                found=f"{name} {described[name]}",
                expected=str(value),
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

    return prepare
