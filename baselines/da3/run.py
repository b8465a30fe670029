"""Relative depth of photos by DA3MONO-LARGE, for `legoworld baseline run da3`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from legoworld_baseline import (
    Refused,
    hugging_face,
    library_versions,
    read_photo,
    serve,
    write_depth,
)
from legoworld_baseline.devices import check_dtype, check_dtype_on, device_type

LIBRARIES = ("depth-anything-3", "einops", "numpy", "omegaconf", "opencv-python-headless", "torch")


@dataclass(frozen=True, kw_only=True)
class Model:
    """The network on its device and how it is used."""

    network: Any
    dtype: Any
    sky: Any
    seed: int
    request: dict[str, Any]


def load(request: dict[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The network with its weights, and what its numbers depend on. Refused when not as asked."""
    sky, seed = request["options"]["sky"], request["options"]["seed"]
    if seed < 0:
        raise Refused("the seed is negative", found=f"seed={seed}", expected="0, 1, 2, ...")
    check_dtype(request["dtype"])
    files = hugging_face.resolve(request["weights"], offline=request["offline"])
    _check_model_name(files)
    check_dtype_on(request["dtype"], request["device"])
    import torch
    from da3_network import build, load_weights
    from safetensors.torch import load_file

    torch.backends.cudnn.allow_tf32 = False
    network = build()
    tensors = {}
    for path in files.weights:
        tensors.update(load_file(path))
    load_weights(network, tensors)
    model = Model(
        network=network.to(request["device"]),
        dtype=getattr(torch, request["dtype"]),
        sky=sky,
        seed=seed,
        request=request,
    )
    return model, _provenance(request, files, sky, seed)


def predict(model: Model, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's depth into the run folder."""
    from da3_grid import written_array
    from da3_input import network_photo
    from da3_network import predict_depth

    width, height = image["width"], image["height"]
    photo = network_photo(read_photo(image["path"], width, height))
    depth, n_sky = predict_depth(model.network, photo, model.dtype, model.sky, model.seed)
    values = written_array(depth, (width, height))
    result = write_depth(model.request, image, values, "depth", None)
    counts = {"network_px": depth.size, "sky_px": n_sky}
    return {**result, "counts": counts}


def _check_model_name(files: hugging_face.ModelFiles) -> None:
    """The metric model has the same network and keys: only config.json tells them apart."""
    from da3_network import MODEL_NAME

    path = files.folder / "config.json"
    name = None
    if path.is_file():
        name = json.loads(path.read_text(encoding="utf-8")).get("model_name")
    if name != MODEL_NAME:
        raise Refused(
            "config.json does not identify the weights as DA3MONO-LARGE",
            found=f"model_name {name!r} in config.json" if path.is_file() else "no config.json",
            expected=f"model_name {MODEL_NAME!r}",
            next_step="pass the whole folder of depth-anything/DA3MONO-LARGE; DA3METRIC-LARGE has"
            " the same network and would load without a warning",
        )
    if any(path.suffix != ".safetensors" for path in files.weights):
        raise Refused(
            "the weights are not in safetensors format",
            found=files.weights[0].name,
            expected="*.safetensors",
        )


def _provenance(
    request: dict[str, Any], files: hugging_face.ModelFiles, sky: str, seed: int
) -> dict[str, Any]:
    from da3_input import IMAGE_MEAN, IMAGE_STD, LONGEST_SIDE_PX, PATCH_PX
    from da3_sky import FAR_QUANTILE, MIN_PIXELS, SAMPLE_SIZE, SKY_THRESHOLD

    return {
        **files.provenance(),
        "libraries": library_versions(LIBRARIES),
        "device": device_type(request["device"]),
        "dtype": request["dtype"],
        "precision": "backbone under autocast, head in float32"
        if request["dtype"] != "float32"
        else "float32",
        "preprocessing": {
            "longest_side_px": LONGEST_SIDE_PX,
            "side_multiple_px": PATCH_PX,
            "resize": "uint8, cubic when a side grows, else area",
            "mean": list(IMAGE_MEAN),
            "std": list(IMAGE_STD),
            "exif_orientation": "not applied",
        },
        "depth": {"space": "depth", "unit": None, "size": "network, at most the photo's"},
        "sky": {
            "policy": sky,
            "threshold": SKY_THRESHOLD,
            "quantile": FAR_QUANTILE,
            "sample": SAMPLE_SIZE,
            "min_px": MIN_PIXELS,
        },
        "seed": seed,
    }


if __name__ == "__main__":
    serve(load, predict)
