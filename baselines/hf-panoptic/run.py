"""Panoptic segments by MaskFormer or Mask2Former, for `legoworld baseline run hf-panoptic`."""

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
from legoworld_baseline.image_processors import load_processor, processor_record

LIBRARIES = ("huggingface-hub", "numpy", "pillow", "pycocotools", "scipy", "torch", "transformers")


@dataclass(frozen=True, kw_only=True)
class Model:
    """A network, its image processor, and category ids by the network's classes."""

    network: Any
    processor: Any
    categories: dict[int, int]
    threshold: float
    overlap: float


def load(request: dict[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The model and what its segments depend on. Refused when not as asked."""
    options = request["options"]
    if not (0.0 <= options["threshold"] <= 1.0 and 0.0 <= options["overlap"] <= 1.0):
        raise Refused(
            "an option is out of range",
            found=f"threshold={options['threshold']}, overlap={options['overlap']}",
            expected="shares of 0 to 1",
        )
    files = hugging_face.resolve(request["weights"], offline=request["offline"])

    from panoptic_network import load_config, load_network

    labels = load_config(files.folder).id2label
    category_of = match_labels(request, labels.values())
    processor = load_processor(files.folder)
    model = Model(
        network=load_network(files.folder, request["device"], request["dtype"]),
        processor=processor,
        categories={n: category_of[name] for n, name in labels.items() if name in category_of},
        threshold=options["threshold"],
        overlap=options["overlap"],
    )
    provenance = {
        **files.provenance(),
        "architecture": type(model.network).__name__,
        "libraries": library_versions(LIBRARIES),
        "device": device_type(request["device"]),
        "dtype": request["dtype"],
        "labels": category_of,
        "preprocessing": {**processor_record(processor), "exif_orientation": "not applied"},
        "segments": "transformers' post_process_panoptic_segmentation at the photo's size",
        "threshold": options["threshold"],
        "overlap": options["overlap"],
        "seed": None,
    }
    return model, provenance


def predict(model: Model, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's segments as masks that do not overlap."""
    from panoptic_network import entries, segments

    photo = read_photo(image["path"], image["width"], image["height"])
    ids, listed = segments(
        model.network, model.processor, photo, threshold=model.threshold, overlap=model.overlap
    )
    found, counts = entries(ids, listed, model.categories)
    return {"predictions": found, "counts": counts}


if __name__ == "__main__":
    serve(load, predict)
