"""Detectors of transformers without torchvision: processor, network, one photo at a time."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers
from detector_boxes import categories_of_labels
from legoworld_baseline import Refused, match_labels
from legoworld_baseline.hugging_face import load_pretrained, read_config
from legoworld_baseline.image_processors import load_processor
from legoworld_baseline.model_kinds import wrong_kind
from numpy.typing import NDArray
from transformers.image_utils import ChannelDimension

THRESHOLD = 0.0


@dataclass(frozen=True, kw_only=True)
class Detector:
    """A network with what belongs to it.

    category_of_label: label index to category id; post: arguments of the processor's
    post_process_object_detection besides outputs, threshold and size.
    """

    network: Any
    processor: Any
    category_of_label: dict[int, int]
    post: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Labels:
    """How the model's labels met the vocabulary: category by index, and names without a partner."""

    category_of_label: dict[int, int]
    without_category: tuple[str, ...]
    without_label: tuple[str, ...]


def load_detector(
    folder: Path, labels: Labels, *, device: str, dtype: str, top_k: int | None, backend: str
) -> Detector:
    """The model of a folder. Refused when it is no detector or cannot be run as it is.

    backend: of the image processor, "pil" or "torchvision".
    """
    processor = load_processor(folder, backend)
    network = load_pretrained(
        transformers.AutoModelForObjectDetection, folder, device=device, dtype=dtype
    )
    return Detector(
        network=network,
        processor=processor,
        category_of_label=labels.category_of_label,
        post=_post_arguments(processor, network.config, top_k),
    )


def read_labels(folder: Path, request: dict[str, Any]) -> Labels:
    """The model's labels matched to the request's categories by name.

    Refused as `match_labels` says, and when one name that counts stands at two indices.
    """
    config = _config(folder)
    names = {int(index): str(name) for index, name in config.id2label.items()}
    matched = match_labels(
        request, names.values(), every_category=request["options"]["every_category"]
    )
    categories, twice = categories_of_labels(names, matched)
    if twice:
        raise Refused(
            "several classes of the model share one label name",
            found=", ".join(map(repr, twice[:4])),
            expected="each name once",
            next_step="correct id2label in the model's config.json",
        )
    return Labels(
        category_of_label=categories,
        without_category=tuple(sorted(set(names.values()) - set(matched))),
        without_label=tuple(
            c["name"] for c in request["categories"] if c["id"] not in categories.values()
        ),
    )


@torch.inference_mode()
def detect(detector: Detector, rgb: NDArray[np.uint8]) -> dict[str, torch.Tensor]:
    """(H, W, 3) uint8 RGB to float32 "boxes" x0, y0, x1, y1 in its pixels, "scores", "labels"."""
    network = detector.network
    inputs = detector.processor(
        images=rgb, input_data_format=ChannelDimension.LAST, return_tensors="pt"
    )
    inputs = {name: tensor.to(network.device) for name, tensor in inputs.items()}
    inputs["pixel_values"] = inputs["pixel_values"].to(network.dtype)
    outputs = network(**inputs)
    outputs.logits, outputs.pred_boxes = outputs.logits.float(), outputs.pred_boxes.float()
    if not (outputs.logits.isfinite().all() and outputs.pred_boxes.isfinite().all()):
        raise ArithmeticError("the network's output contains NaN or infinity")
    size_hw = torch.tensor([rgb.shape[:2]], device=network.device)
    (found,) = detector.processor.post_process_object_detection(
        outputs, threshold=THRESHOLD, target_sizes=size_hw, **detector.post
    )
    return {name: tensor.cpu() for name, tensor in found.items()}


def _config(folder: Path) -> Any:
    config = read_config(folder)
    if type(config) not in transformers.AutoModelForObjectDetection._model_mapping:
        raise wrong_kind(
            "this model is not a closed-set object detector",
            config,
            expected="a model of transformers' AutoModelForObjectDetection",
        )
    return config


def _post_arguments(processor: Any, config: Any, top_k: int | None) -> dict[str, Any]:
    """What this processor's post-processing takes, and the model's configuration says."""
    taken = inspect.signature(processor.post_process_object_detection).parameters
    found: dict[str, Any] = {}
    if "use_focal_loss" in taken:
        standard = taken["use_focal_loss"].default
        found["use_focal_loss"] = bool(getattr(config, "use_focal_loss", standard))
    if top_k is not None and "top_k" not in taken:
        raise Refused(
            "this model's post-processing has no top_k",
            found=f"top_k={top_k} for {type(processor).__name__}",
            expected="one detection per query, or as many detections as queries",
            next_step="omit --option top_k",
        )
    if "top_k" in taken:
        found["top_k"] = taken["top_k"].default if top_k is None else top_k
    return found
