"""MaskFormer and Mask2Former of transformers without torchvision: loading and forward pass."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers
from legoworld_baseline.hugging_face import load_pretrained, read_config
from legoworld_baseline.model_kinds import wrong_kind
from numpy.typing import NDArray
from segmenter_input import Prepare

#: Both give, per query, a distribution over classes and "nothing", and one mask.
MODEL_TYPES = ("mask2former", "maskformer")


@dataclass(frozen=True, kw_only=True)
class Queries:
    """What the network says of a photo, q queries.

    class_shares: (q, classes) float32, softmax without the last class, "nothing". mask_logits:
    (q, h, w) over the network's input of input_hw pixels, of which the top left valid_hw are the
    photo and the rest is padding.
    """

    class_shares: torch.Tensor
    mask_logits: torch.Tensor
    input_hw: tuple[int, int]
    valid_hw: tuple[int, int]


def load_config(folder: Path) -> Any:
    """The model's configuration. Refused when it gives no instances."""
    config = read_config(folder)
    if config.model_type in MODEL_TYPES:
        return config
    universal = type(config) in transformers.AutoModelForUniversalSegmentation._model_mapping
    semantic = type(config) in transformers.AutoModelForSemanticSegmentation._model_mapping
    what = "this segmenter is not one that is read here"
    if semantic and not universal:
        what = "this model gives one class per pixel and no instances"
    raise wrong_kind(what, config, expected=" or ".join(MODEL_TYPES))


def load_network(folder: Path, device: str, dtype: str) -> Any:
    """The network with every parameter out of the checkpoint. Refused otherwise."""
    return load_pretrained(
        transformers.AutoModelForUniversalSegmentation, folder, device=device, dtype=dtype
    )


@torch.inference_mode()
def queries(network: Any, prepare: Prepare, photo: NDArray[np.uint8]) -> Queries:
    """Ask the network about a photo (H, W, 3). ValueError when a number is not finite."""
    pixels, shown = prepare(photo)
    mask = shown[0].bool()
    out = network(
        pixel_values=pixels.to(network.device, network.dtype),
        pixel_mask=shown.to(network.device),
    )
    shares = out.class_queries_logits[0].float().softmax(dim=-1)[:, :-1]
    if not torch.isfinite(shares).all():
        raise ValueError("the network's scores are not finite (with float16, try float32)")
    return Queries(
        class_shares=shares,
        mask_logits=out.masks_queries_logits[0].float(),
        input_hw=(int(pixels.shape[2]), int(pixels.shape[3])),
        valid_hw=(int(mask.any(dim=1).sum()), int(mask.any(dim=0).sum())),
    )
