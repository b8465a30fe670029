"""Boxes in space of chairs and cups by Objectron, for `legoworld baseline run objectron`."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import legoworld_baseline as baseline
import numpy as np
from legoworld_baseline import Refused

NAMES = ("chair", "cup")
SIDE = 224
#: Interpreter and height by category id; regions, and K where it is known, by image id; fov_deg.
Loaded = tuple[dict[int, tuple[Any, float]], dict[int, Any], dict[int, Any], float]


def load(request: dict[str, Any]) -> tuple[Loaded, dict[str, Any]]:
    """The networks, the regions, and what boxes depend on. Refused when a file is unusable."""
    options, folder = request["options"], Path(request["weights"])
    if request["device"] not in ("cpu", "auto"):
        raise Refused("a TFLite model runs on the CPU", found=request["device"], expected="cpu")
    heights = [options[f"{name}_height_m"] for name in NAMES]
    if not 0 < options["fov_deg"] < 180 or not all(0 < height < np.inf for height in heights):
        raise Refused("an option is out of range", found=str(options), expected="above 0")
    models = [folder / f"object_detection_3d_{name}.tflite" for name in NAMES]
    files = [*models, folder / options["regions"]]
    if missing := [path.name for path in files if not path.is_file()]:
        raise Refused("the weights' folder lacks a file", found="no " + ", ".join(missing))
    ids = baseline.match_labels(request, NAMES, every_category=False)
    regions, cameras = read_regions(files[-1], set(ids.values()))
    by_name = zip(NAMES, models, heights, strict=True)
    networks = {
        ids[name]: (_network(path), height) for name, path, height in by_name if name in ids
    }
    return (networks, regions, cameras, options["fov_deg"]), {
        "weight_files": baseline.hash_files(files),
        "libraries": baseline.library_versions(("ai-edge-litert", "numpy", "pillow", "scipy")),
        "device": "cpu",
        "preprocessing": {"square": 1.5, "resized": "bilinear, edges repeated",
                          "exif_orientation": "not applied"},
        "box": "EPnP, then least squares in the photo, scaled to the stated height",
        "score": "the region's times the network's",
        "seed": None,
    }  # fmt: skip


def read_regions(path: Path, category_ids: set[int]) -> tuple[dict[int, Any], dict[int, Any]]:
    """Boxes of these categories, and matrices K, by image id. Refused when they are unusable."""
    regions, cameras = defaultdict(list), {}
    try:
        document = json.loads(path.read_bytes())
        about = document if isinstance(document, dict) else {"annotations": document}
        for image in about.get("images", ()):
            if "K" in image:
                cameras[image["id"]] = np.array(image["K"], float).reshape(3, 3)
        for entry in about["annotations"]:
            if entry["category_id"] in category_ids and not entry.get("iscrowd"):
                box = np.array(entry["bbox"], float).reshape(4)
                if not np.isfinite(box).all() or box[2:].min() <= 0:
                    raise ValueError(f"bbox {entry['bbox']}")
                score = float(entry.get("score", 1.0))
                regions[entry["image_id"]].append({**entry, "score": score})
    except (ValueError, KeyError, TypeError) as error:
        entry = "image_id, category_id, bbox, score"
        raise Refused(f"{path.name} gives no regions", found=repr(error), expected=entry) from error
    return regions, cameras


def _network(path: Path) -> Any:
    from ai_edge_litert.interpreter import Interpreter

    try:  # one thread: the same sums on every machine of a kind
        interpreter = Interpreter(model_path=str(path), num_threads=1)
        interpreter.allocate_tensors()
    except (ValueError, RuntimeError) as error:
        raise Refused("the model cannot be loaded", found=str(error), expected="TFLite") from error
    return interpreter


def predict(loaded: Loaded, image: dict[str, Any]) -> dict[str, Any]:
    """One photo's boxes, at most one a region."""
    from objectron_box import box_in_space, camera_of, crop, square_around

    number, size_wh = image["image_id"], (image["width"], image["height"])
    photo = baseline.read_photo(image["path"], *size_wh)
    networks, by_image, cameras, fov_deg = loaded
    camera = cameras.get(number, camera_of(fov_deg, size_wh))
    regions, found = by_image.get(number, []), []
    for region in regions:
        network, height_m = networks[region["category_id"]]
        left, top, side = square = square_around(region["bbox"])
        network.set_tensor(network.get_input_details()[0]["index"], crop(photo, square, SIDE)[None])
        network.invoke()
        given = [network.get_tensor(o["index"]).ravel() for o in network.get_output_details()]
        score, points = sorted((g.astype(float) for g in given), key=len)
        corners = box_in_space(points.reshape(9, 2) / SIDE * side + [left, top], camera, height_m)
        if corners is not None:
            box = {"bbox3D": corners.tolist(), "score": float(score[0]) * region["score"]}
            found.append({"image_id": number, "category_id": region["category_id"], **box})
    counts = {"regions": len(regions), "without_box": len(regions) - len(found)}
    return {"predictions": found, "counts": counts}


if __name__ == "__main__":
    baseline.serve(load, predict)
