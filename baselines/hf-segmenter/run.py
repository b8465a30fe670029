"""Instances of photos by MaskFormer or Mask2Former, for `legoworld baseline run hf-segmenter`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from legoworld_baseline import (
    Refused,
    hugging_face,
    library_versions,
    match_labels,
    read_photo,
    serve,
)
from legoworld_baseline.devices import device_type

LIBRARIES = ("huggingface-hub", "numpy", "pillow", "pycocotools", "scipy", "torch", "transformers")


@dataclass(frozen=True, kw_only=True)
class Model:
    """A network, how a photo becomes its input, and what becomes of its queries."""

    network: Any
    prepare: Any
    rules: Any


def load(request: dict[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The model and what its detections depend on. Refused when not as asked."""
    options = request["options"]
    if options["per_image"] < 1 or not 0.0 <= options["min_score"] <= 1.0:
        raise Refused(
            "an option is out of range",
            found=f"per_image={options['per_image']}, min_score={options['min_score']}",
            expected="per_image of 1 or more, min_score of 0 to 1",
        )
    files = hugging_face.resolve(request["weights"], offline=request["offline"])

    from segmenter_input import preparation
    from segmenter_instances import Rules
    from segmenter_network import load_config, load_network

    labels = load_config(files.folder).id2label
    category_of = match_labels(request, labels.values())
    prepare, prepared = preparation(files.folder, options["input"])
    model = Model(
        prepare=prepare,
        network=load_network(files.folder, request["device"], request["dtype"]),
        rules=Rules(
            categories={n: category_of[name] for n, name in labels.items() if name in category_of},
            per_image=options["per_image"],
            min_score=options["min_score"],
            boxes=request["task"] == "coco",
        ),
    )
    provenance = {
        **files.provenance(),
        "architecture": type(model.network).__name__,
        "libraries": library_versions(LIBRARIES),
        "device": device_type(request["device"]),
        "dtype": request["dtype"],
        "labels": category_of,
        "preprocessing": {**prepared, "exif_orientation": "not applied"},
        "masks": "logits to the network's input, padding cut off, to the photo (bilinear), > 0",
        "score": "share of the class * mean probability inside the mask",
        "threshold": options["min_score"],
        "cap": {
            "per_image": options["per_image"],
            "order": ["share of the class, highest first", "category id", "query"],
        },
        "seed": None,
    }
    return model, provenance


def predict(model: Model, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's detections."""
    from segmenter_instances import detections
    from segmenter_network import queries

    size_wh = image["width"], image["height"]
    photo = read_photo(image["path"], *size_wh)
    said = queries(model.network, model.prepare, photo)
    entries, counts = detections(said, model.rules, image["image_id"], size_wh)
    return {"predictions": entries, "counts": counts}


if __name__ == "__main__":
    serve(load, predict)
