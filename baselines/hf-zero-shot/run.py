"""Boxes of a vocabulary's categories by zero-shot detectors of transformers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from legoworld_baseline import Refused, hugging_face, library_versions, read_photo, serve
from legoworld_baseline.devices import device_type

_LIBRARIES = (
    "huggingface-hub", "numpy", "pillow", "safetensors", "tokenizers", "torch", "transformers",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Loaded:
    """A detector that is asked for every category, and how many boxes are kept."""

    model: Any
    category_ids: tuple[int, ...]
    per_image: int
    min_score: float


def load(request: dict[str, Any]) -> tuple[Loaded, dict[str, Any]]:
    """The detector with its prompts, and what its numbers depend on. Refused when not as asked."""
    options = request["options"]
    if options["per_image"] < 1 or not 0.0 <= options["min_score"] <= 1.0:
        raise Refused(
            "an option is out of range",
            found=f"per_image={options['per_image']}, min_score={options['min_score']}",
            expected="per_image of 1 or more, min_score of 0 to 1",
            next_step="omit the option",
        )
    files = hugging_face.resolve(request["weights"], offline=request["offline"])

    from legoworld_baseline.image_processors import processor_record
    from zero_shot_networks import load_config, load_model
    from zero_shot_prompts import DEFAULT_TEMPLATES, phrases

    config = load_config(files.folder)
    template = options["template"] or DEFAULT_TEMPLATES[config.model_type]
    asked = phrases([c["name"] for c in request["categories"]], template)
    model = load_model(
        files.folder,
        asked,
        device=request["device"],
        dtype=request["dtype"],
        caption=options["caption"],
    )
    category_ids = tuple(c["id"] for c in request["categories"])
    provenance = {
        **files.provenance(),
        "network": type(model.network).__name__,
        "preprocessing": {**processor_record(model.processor), "exif_orientation": "ignored"},
        "libraries": library_versions(_LIBRARIES),
        "dtype": request["dtype"],
        "device": device_type(request["device"]),
        "batch_size": 1,
        "prompts": {
            "template": template,
            "strings": dict(zip(map(str, category_ids), asked, strict=True)),
            **model.record,
        },
        "threshold": options["min_score"],
        "cap": {
            "per_image": options["per_image"],
            "order": ["score, highest first", "category id", "box of the network"],
        },
        "nms": None,
        "clipped_to_photo": False,
    }
    return Loaded(
        model=model,
        category_ids=category_ids,
        per_image=options["per_image"],
        min_score=options["min_score"],
    ), provenance


def predict(loaded: Loaded, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's detections."""
    from zero_shot_networks import detect
    from zero_shot_selection import results

    photo = read_photo(image["path"], image["width"], image["height"])
    entries, counts = results(
        detect(loaded.model, photo),
        loaded.category_ids,
        image["image_id"],
        per_image=loaded.per_image,
        min_score=loaded.min_score,
    )
    return {"predictions": entries, "counts": counts}


if __name__ == "__main__":
    serve(load, predict)
