"""Any object detector of transformers on photos: legoworld's request in, COCO results out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from legoworld_baseline import library_versions, read_photo, serve
from legoworld_baseline.devices import device_type

if TYPE_CHECKING:
    from detector import Detector

_LIBRARIES = ("torch", "transformers", "numpy", "pillow", "safetensors", "huggingface-hub")


def load(request: dict[str, Any]) -> tuple[Detector, dict[str, Any]]:
    """The detector that the request names, and what its numbers depend on."""
    from legoworld_baseline.hugging_face import resolve
    from legoworld_baseline.image_processors import processor_record

    files = resolve(request["weights"], offline=request["offline"])
    from detector import THRESHOLD, load_detector, read_labels

    labels = read_labels(files.folder, request)
    detector = load_detector(
        files.folder,
        labels,
        device=request["device"],
        dtype=request["dtype"],
        top_k=request["options"]["top_k"],
        backend=request["options"]["backend"],
    )
    provenance = files.provenance() | {
        "network": type(detector.network).__name__,
        "preprocessing": {
            **processor_record(detector.processor),
            "exif_orientation": "ignored",
        },
        "postprocessing": detector.post,
        "labels": {
            "matched": len(labels.category_of_label),
            "without_category": list(labels.without_category),
            "categories_without_label": list(labels.without_label),
        },
        "libraries": library_versions(_LIBRARIES),
        "dtype": request["dtype"],
        "device": device_type(request["device"]),
        "batch_size": 1,
        "threshold": THRESHOLD,
        "clipped_to_photo": False,
        "prompts": None,
    }
    return detector, provenance


def predict(detector: Detector, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's detections."""
    from detector import detect
    from detector_boxes import coco_results

    rgb = read_photo(image["path"], image["width"], image["height"])
    results, without_category = coco_results(
        detect(detector, rgb), detector.category_of_label, image["image_id"]
    )
    return {
        "predictions": results,
        "counts": {"predictions": len(results), "without_category": without_category},
    }


if __name__ == "__main__":
    serve(load, predict)
