"""MaskFormer and Mask2Former of transformers: loading, and a photo's panoptic segments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers
from legoworld_baseline.hugging_face import load_pretrained, read_config
from legoworld_baseline.model_kinds import wrong_kind
from numpy.typing import NDArray
from PIL import Image
from pycocotools import mask as coco_mask

MODEL_TYPES = ("mask2former", "maskformer")


def load_config(folder: Path) -> Any:
    """The model's configuration. Refused when it gives no panoptic segments."""
    config = read_config(folder)
    if config.model_type in MODEL_TYPES:
        return config
    what = "this segmenter is not one that is read here"
    raise wrong_kind(what, config, expected=" or ".join(MODEL_TYPES))


def load_network(folder: Path, device: str, dtype: str) -> Any:
    """The network with every parameter out of the checkpoint. Refused otherwise."""
    return load_pretrained(
        transformers.AutoModelForUniversalSegmentation, folder, device=device, dtype=dtype
    )


@torch.inference_mode()
def segments(
    network: Any, processor: Any, photo: NDArray[np.uint8], *, threshold: float, overlap: float
) -> tuple[NDArray[np.int64], list[tuple[int, int]]]:
    """(H, W) ids and (id, class) of each segment, by transformers' own post-processing.

    Stuff is not fused here: legoworld makes one segment of a stuff category.
    """
    inputs = processor(images=Image.fromarray(photo), return_tensors="pt")
    out = network(
        pixel_values=inputs["pixel_values"].to(network.device, network.dtype),
        pixel_mask=inputs["pixel_mask"].to(network.device),
    )
    out.class_queries_logits = out.class_queries_logits.float()
    out.masks_queries_logits = out.masks_queries_logits.float()
    if not torch.isfinite(out.class_queries_logits).all():
        raise ValueError("the network's scores are not finite (with float16, try float32)")
    found = processor.post_process_panoptic_segmentation(
        out,
        threshold=threshold,
        overlap_mask_area_threshold=overlap,
        label_ids_to_fuse=set(),
        target_sizes=[photo.shape[:2]],
    )[0]
    listed = [(int(one["id"]), int(one["label_id"])) for one in found["segments_info"]]
    return found["segmentation"].cpu().numpy().astype(np.int64), listed


def entries(
    ids: NDArray[np.int64], listed: list[tuple[int, int]], categories: dict[int, int]
) -> tuple[list[dict[str, Any]], dict[str, int]]:
    """A mask of each segment whose class is a category, in order, and what was left out."""
    found, counts = [], {"segments": len(listed), "no_category": 0}
    for number, label in listed:
        if label not in categories:
            counts["no_category"] += 1
            continue
        encoded: Any = coco_mask.encode(np.asfortranarray(ids == number, np.uint8))
        rle = {"size": list(map(int, encoded["size"])), "counts": encoded["counts"].decode("ascii")}
        found.append({"category_id": categories[label], "segmentation": rle})
    return found, counts
