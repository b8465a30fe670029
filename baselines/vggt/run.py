"""Camera and relative depth of photos by VGGT, for `legoworld plugin evidence --provider vggt`.

Also `legoworld baseline run vggt --task eth3d`, where the depth alone is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from legoworld_baseline import (
    Refused,
    hash_files,
    hugging_face,
    library_versions,
    read_photo,
    serve,
    write_depth,
)
from legoworld_baseline.devices import check_dtype, check_dtype_on, device_type

LIBRARIES = ("einops", "huggingface-hub", "numpy", "pillow", "safetensors", "torch")
_FILES = (".pt", ".safetensors")


@dataclass(frozen=True, kw_only=True)
class Model:
    """The network on its device and how it is used."""

    network: Any
    dtype: Any
    request: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Weights:
    """The files of the parameters. folder: with config.json, None for a single file."""

    paths: tuple[Path, ...]
    folder: Path | None
    provenance: dict[str, Any]


def load(request: dict[str, Any]) -> tuple[Model, dict[str, Any]]:
    """The network with its weights, and what its numbers depend on. Refused when not as asked."""
    _check_options(request)
    weights = _weights(request)
    check_dtype_on(request["dtype"], request["device"])
    import torch
    from vggt_network import build, is_out_of_memory, load_weights, read_weights, sizes_of

    torch.backends.cudnn.allow_tf32 = False
    depth = request["options"]["depth"]
    try:
        network = build(sizes_of(weights.folder), depth=depth)
        load_weights(network, read_weights(weights.paths), depth=depth)
        network = network.to(request["device"])
    except (RuntimeError, MemoryError) as error:
        if not is_out_of_memory(error):
            raise
        raise Refused(
            "the network does not fit into the memory",
            found=f"{request['device']}: {' '.join(str(error).split())[:200]}",
            expected="room for 1.2 billion parameters: 5 GB in float32",
            next_step="another --device, or a machine with more memory",
        ) from error
    model = Model(network=network, dtype=getattr(torch, request["dtype"]), request=request)
    return model, _provenance(request, weights)


def predict(model: Model, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's camera, and its depth into the run folder."""
    from vggt_camera import photo_camera
    from vggt_depth import photo_depth
    from vggt_input import fit, network_photo
    from vggt_network import is_out_of_memory
    from vggt_network import predict as run

    options = model.request["options"]
    size = image["width"], image["height"]
    placed = fit(size, options["mode"])
    photo = network_photo(read_photo(image["path"], *size), placed)
    try:
        intrinsics, depth, confidence = run(model.network, photo, model.dtype)
    except (RuntimeError, MemoryError) as error:
        if not is_out_of_memory(error):
            raise
        short = " ".join(str(error).split())[:240]
        return {"failed": f"out of memory on {model.request['device']}: {short}"}
    answer: dict[str, Any] = {"camera": photo_camera(intrinsics, placed)}
    counts = {"network_px": photo.shape[1] * photo.shape[2]}
    if depth is not None and confidence is not None:
        values = photo_depth(depth, confidence, placed, options["least_confidence"])
        answer |= write_depth(model.request, image, values, "depth", None)
        counts["unsure_px"] = int((confidence < options["least_confidence"]).sum())
    return {**answer, "counts": counts}


def _check_options(request: dict[str, Any]) -> None:
    check_dtype(request["dtype"])
    if request["dtype"] != "float32" and device_type(request["device"]) != "cuda":
        raise Refused(
            "half precision is run on CUDA devices alone",
            found=f"{request['dtype']} on {request['device']}",
            expected="float32: the package keeps its heads in float32 under CUDA's autocast only",
            next_step="pass --dtype float32",
        )
    if request["task"] != "camera" and not request["options"]["depth"]:
        raise Refused(
            "this run is of depth",
            found="depth=false",
            expected="depth=true",
            next_step="leave --option depth=false to `legoworld plugin evidence --provider vggt`",
        )


def _weights(request: dict[str, Any]) -> Weights:
    path = Path(request["weights"])
    if not path.is_file():
        files = hugging_face.resolve(request["weights"], offline=request["offline"])
        return Weights(paths=files.weights, folder=files.folder, provenance=files.provenance())
    if path.suffix not in _FILES:
        raise Refused(
            "the weights are a file of another kind",
            found=path.name,
            expected=" or ".join(f"*{suffix}" for suffix in _FILES),
            next_step="give facebook/VGGT-1B, its folder, or its model.pt",
        )
    told = {"model": path.name, "revision": None, "weight_files": hash_files([path])}
    return Weights(paths=(path,), folder=None, provenance={**told, "config_files": []})


def _provenance(request: dict[str, Any], weights: Weights) -> dict[str, Any]:
    from vggt_input import PATCH_PX, SIDE_PX
    from vggt_network import package_provenance

    return {
        **weights.provenance,
        "package": package_provenance(),
        "libraries": library_versions(LIBRARIES),
        "device": device_type(request["device"]),
        "dtype": request["dtype"],
        "precision": "aggregator under autocast, heads in float32"
        if request["dtype"] != "float32"
        else "float32",
        "preprocessing": {
            "mode": request["options"]["mode"],
            "side_px": SIDE_PX,
            "side_multiple_px": PATCH_PX,
            "resize": "uint8, bicubic (Pillow)",
            "exif_orientation": "not applied",
        },
        "camera": {"rotation": None, "principal_point": "the middle of what the network sees"},
        "depth": {"space": "depth", "unit": None, "size": "network grid, at most the photo's"},
    }


if __name__ == "__main__":
    serve(load, predict)
