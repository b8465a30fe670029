"""Classes of photos' pixels by DeepLab v3 as TFLite, for `legoworld baseline run deeplab`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from legoworld_baseline import Refused, hash_files, library_versions, read_photo, serve

LIBRARIES = ("ai-edge-litert", "numpy", "pillow", "pycocotools")
CLASSES = 21


@dataclass(frozen=True, kw_only=True)
class Model:
    """The interpreter, the side of its square input, and what its classes are."""

    interpreter: Any
    side: int
    input: str
    category_ids: set[int]


def load(request: dict[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The model and what its classes depend on. Refused when it is not such a model."""
    if request["device"] not in ("cpu", "auto"):
        raise Refused("a TFLite model runs on the CPU", found=request["device"], expected="cpu")
    weights = Path(request["weights"])
    if not weights.is_file():
        raise Refused("the weights are one file", found=weights.name, expected="a .tflite file")
    ids = {category["id"] for category in request["categories"]}
    if ids != set(range(CLASSES)):
        raise Refused(
            "the vocabulary is not Pascal VOC's",
            found=f"{len(ids)} categories",
            expected="ids 0 to 20, background and the 20 classes",
        )
    from ai_edge_litert.interpreter import Interpreter

    try:
        # One thread: the same sums on every machine of a kind.
        interpreter = Interpreter(model_path=str(weights), num_threads=1)
        interpreter.allocate_tensors()
    except (ValueError, RuntimeError) as error:
        raise Refused("the model cannot be loaded", found=str(error), expected="TFLite") from error
    taken, given = interpreter.get_input_details()[0], interpreter.get_output_details()[0]
    side = int(taken["shape"][1])
    if taken["dtype"] != np.uint8 or list(taken["shape"]) != [1, side, side, 3]:
        raise Refused("the model takes another input", found=str(list(taken["shape"])),
                      expected="(1, side, side, 3) uint8")  # fmt: skip
    if list(given["shape"]) != [1, side, side]:
        raise Refused("the model gives something else", found=str(list(given["shape"])),
                      expected="(1, side, side) class ids")  # fmt: skip
    how = request["options"]["input"]
    model = Model(interpreter=interpreter, side=side, input=how, category_ids=ids)
    provenance = {
        "weight_files": hash_files([weights]),
        "libraries": library_versions(LIBRARIES),
        "device": "cpu",
        "preprocessing": {"side": side, "input": how, "resized": "bilinear, Pillow",
                          "exif_orientation": "not applied"},
        "classes": "the network's, padding cut off, to the photo by the nearest neighbour",
        "seed": None,
    }  # fmt: skip
    return model, provenance


def predict(model: Model, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's classes as masks."""
    from deeplab_input import at_photo_size, entries, prepared

    size_wh = image["width"], image["height"]
    pixels, shown = prepared(read_photo(image["path"], *size_wh), model.side, model.input)
    interpreter = model.interpreter
    interpreter.set_tensor(interpreter.get_input_details()[0]["index"], pixels[None])
    interpreter.invoke()
    classes = interpreter.get_tensor(interpreter.get_output_details()[0]["index"])[0]
    return {"predictions": entries(at_photo_size(classes, shown, size_wh), model.category_ids)}


if __name__ == "__main__":
    serve(load, predict)
