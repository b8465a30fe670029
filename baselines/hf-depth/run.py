"""Depth of photos by any estimator of transformers, for `legoworld baseline run hf-depth`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from depth_declared import Numbers, declared_numbers
from legoworld_baseline import hugging_face, library_versions, read_photo, serve, write_depth
from legoworld_baseline.devices import device_type

LIBRARIES = ("huggingface-hub", "numpy", "pillow", "scipy", "torch", "transformers")


@dataclass(frozen=True, kw_only=True)
class Model:
    """A network, how a photo becomes its input, and what its numbers are."""

    network: Any
    preparation: Any
    numbers: Numbers
    request: dict[str, Any]


def load(request: dict[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The model and what its numbers depend on. Refused when not as asked."""
    files = hugging_face.resolve(request["weights"], offline=request["offline"])

    from depth_network import check_metric, load_config, load_network, load_preparation

    options = request["options"]
    config = load_config(files.folder)
    numbers = declared_numbers(config, options["space"], options["unit"])
    check_metric(config)
    model = Model(
        preparation=load_preparation(files.folder, config.model_type, options["backend"]),
        network=load_network(files.folder, request["device"], request["dtype"]),
        numbers=numbers,
        request=request,
    )
    provenance = {
        **files.provenance(),
        "architecture": type(model.network).__name__,
        "libraries": library_versions(LIBRARIES),
        "device": device_type(request["device"]),
        "dtype": request["dtype"],
        "preprocessing": {**model.preparation.record, "exif_orientation": "not applied"},
        "depth": {
            "space": numbers.space,
            "unit": numbers.unit,
            "said_by": numbers.said_by,
            "size": "network where the scorer takes it, else photo (bilinear in disparity)",
        },
        "seed": None,
    }
    return model, provenance


def predict(model: Model, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's array into the run folder."""
    from depth_grid import written_array
    from depth_network import padding_wh, predicted_depth

    size_wh = image["width"], image["height"]
    photo = read_photo(image["path"], *size_wh)
    values = predicted_depth(model.network, model.preparation.pixel_values(photo))
    padding = padding_wh(model.preparation, size_wh)
    array = written_array(values, model.numbers.space, size_wh, padding)
    result = write_depth(model.request, image, array, model.numbers.space, model.numbers.unit)
    return {**result, "counts": {"network_px": values.size}}


if __name__ == "__main__":
    serve(load, predict)
