"""DINO-R50-4scale on photos: reads legoworld's request, answers with COCO results."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coco_categories import NAME_OF_ID
from legoworld_baseline import Refused, hash_files, library_versions, read_photo, serve
from legoworld_baseline.devices import check_device, device_type

if TYPE_CHECKING:
    from dino_network import Dino

_NAMES_SHOWN = 4


@dataclass(frozen=True, kw_only=True)
class Loaded:
    """The network and where it runs."""

    network: Dino
    device: str


def load(request: dict[str, Any]) -> tuple[Loaded, dict[str, Any]]:
    """The network with the request's weights, and what its numbers depend on."""
    check_request(request)
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    import dino_photo
    import torch
    from dino_boxes import TOP
    from dino_checkpoint import build, read_checkpoint
    from dino_transformer import DinoSize

    torch.backends.cudnn.allow_tf32 = False
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.use_deterministic_algorithms(True, warn_only=True)
    device = request["device"]
    check_device(device)
    path = Path(request["weights"])
    checkpoint = read_checkpoint(path)
    network = build(checkpoint, DinoSize()).to(device)
    provenance = {
        "model": "DINO-R50-4scale (IDEA-Research/DINO)",
        "revision": None,
        "weight_files": hash_files([path]),
        "checkpoint": {"epochs": checkpoint.epochs, "settings": dict(checkpoint.settings)},
        "libraries": library_versions(["torch", "numpy", "pillow"]),
        "preprocessing": {
            "resize": "Pillow bilinear",
            "short_side_px": dino_photo.SHORT_SIDE_PX,
            "long_side_px": dino_photo.LONG_SIDE_PX,
            "mean_rgb": list(dino_photo.MEAN_RGB),
            "std_rgb": list(dino_photo.STD_RGB),
            "exif_orientation": "ignored",
        },
        "dtype": "float32",
        "device": device_type(device),
        "batch_size": 1,
        "threshold": 0.0,
        "cap": TOP,
        "cap_counts_slots_without_category": True,
        "nms": None,
        "clipped_to_photo": False,
        "prompts": None,
    }
    return Loaded(network=network, device=device), provenance


def check_request(request: dict[str, Any]) -> None:
    """Refuse what this network cannot do: other categories, tasks, number formats."""
    asked = {category["id"]: category["name"] for category in request["categories"]}
    if request["task"] != "coco" or asked != NAME_OF_ID:
        other = sorted({*asked.items()} ^ {*NAME_OF_ID.items()})[:_NAMES_SHOWN]
        raise Refused(
            "DINO predicts COCO's 80 categories only",
            found=f"task {request['task']} with {len(asked)} categories; they differ in {other}",
            expected="task coco with COCO 2017's 80 ids and names",
            next_step="make the track with `legoworld track make --task coco`",
        )
    if request["dtype"] != "float32":
        raise Refused(
            "DINO runs in float32 only",
            found=str(request["dtype"]),
            expected="float32: half precision moves the sampling points of its attention",
            next_step="omit --dtype",
        )


def predict(loaded: Loaded, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's detections."""
    import torch
    from dino_boxes import coco_results
    from dino_photo import normalised

    rgb = read_photo(image["path"], image["width"], image["height"])
    with torch.inference_mode():
        logits, boxes = loaded.network(normalised(rgb).to(loaded.device))
    if not (logits.isfinite().all() and boxes.isfinite().all()):
        raise ArithmeticError("the network's output contains NaN or infinity")
    results, without_category = coco_results(
        logits.cpu(),
        boxes.cpu(),
        image_id=image["image_id"],
        size_wh=(image["width"], image["height"]),
        category_ids=NAME_OF_ID,
    )
    return {
        "predictions": results,
        "counts": {"predictions": len(results), "without_category": without_category},
    }


if __name__ == "__main__":
    serve(load, predict)
