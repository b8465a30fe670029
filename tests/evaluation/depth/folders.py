"""Depth runs and truth folders, written the way readouts and datasets write them."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.depth.family import EVALUATION
from legoworld.evaluation.family import EvaluationRequest
from legoworld.evaluation.run import read_run
from legoworld.readouts.depth import write_depth
from legoworld.records.depth import DepthSummary

#: courtyard's camera in ETH3D's cameras.txt.
COURTYARD = (
    "6048 4032 3411.42 3410.02 3041.29 2014.07 0.21047 0.21102 -5.36231e-06 0.00051541"
    " -0.158023 0.406856 -8.46499e-05 0.000861313"
)
Predictions = dict[str, NDArray[Any] | dict[str, Any] | str]


def evaluate_depth(
    run: Path,
    truth: Path,
    output: Path,
    *,
    camera_model: str = "none",
    draws: int = 2000,
    **others: Any,
) -> DepthSummary:
    """Score a depth run into an evaluation folder. others: of the request."""
    return EVALUATION.evaluate(
        EvaluationRequest(
            run=read_run(run),
            truth=truth,
            output=output,
            draws=draws,
            options={"camera_model": camera_model},
            **others,
        )
    )


def write_run(
    folder: Path,
    predictions: Predictions,
    *,
    size_wh: tuple[int, int] | None = None,
    kind: str = "scene",
    partial: bool = False,
    rendered: bool = True,
) -> Path:
    """A finished run of photos by file name.

    A prediction is planar z in metres; or a dictionary, the arrays of a baseline's .npz; or a
    text, the status of an image without output. Ids count from 1 in the given order.
    """
    rows = []
    for image_id, (name, prediction) in enumerate(predictions.items(), start=1):
        row: dict[str, Any] = {"image_id": image_id, "file_name": name, "warnings": []}
        row |= {"scene": stem(name), "size_wh": list(size_wh) if size_wh else None}
        if isinstance(prediction, str):
            rows.append({**row, "status": prediction, "reason": f"it was {prediction}"})
            continue
        file = f"depth/{stem(name)}.npz"
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        row |= {"status": "ok", "reason": None}
        if isinstance(prediction, dict):
            np.savez(path, **prediction)
        else:
            write_depth(path, prediction.astype(np.float32))
            if rendered:
                row["rendered_wh"] = list(prediction.shape[::-1])
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        rows.append({**row, "depth": {"file": file, "sha256": digest}})
    configuration = {"task": "eth3d", "kind": kind, "attempted": len(rows), "partial": partial}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "run.json").write_text(json.dumps({"configuration": configuration, "scenes": {}}))
    (folder / "per_image.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows))
    return folder


def write_arrays(folder: Path, truth: dict[str, NDArray[Any]], **labels: str) -> Path:
    """A truth folder of labelled .npz files named like the photos."""
    labels = labels or {"space": "depth", "unit": "m"}
    for name, z in truth.items():
        path = folder / f"{stem(name)}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, values=z, **{k: np.array(v) for k, v in labels.items()})
    return folder


def write_eth3d(
    root: Path, truth: dict[str, NDArray[Any]], *, tree: str = "eth3d", camera: str | None = None
) -> Path:
    """ETH3D's raw depth and calibration; tree "marigold" keeps depth apart from rgb.

    camera: cameras.txt's words after the model; a pinhole-like one of the array's size if None.
    """
    photos: dict[str, list[str]] = {}
    for file_name, z in truth.items():
        scene, name = file_name.split("/")[0], PurePosixPath(file_name).name
        base = root / scene if tree == "eth3d" else root / f"depth/{scene}_dslr_depth/{scene}"
        path = base / "ground_truth_depth/dslr_images" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        z.astype("<f4").tofile(path)
        height, width = z.shape
        flat = f"{width} {height} {width} {width} {width / 2} {height / 2}" + " 0" * 8
        rgb = root if tree == "eth3d" else root / "rgb"
        calibration = rgb / scene / "dslr_calibration_jpg"
        calibration.mkdir(parents=True, exist_ok=True)
        line = f"7 THIN_PRISM_FISHEYE {camera or flat}\n"
        (calibration / "cameras.txt").write_text("# Camera list\n" + line)
        photos.setdefault(str(calibration), []).append(name)
    for calibration_folder, names in photos.items():
        lines = [f"{i} 1 0 0 0 .1 .2 .3 7 dslr_images/{n}" for i, n in enumerate(names)]
        text = "# Image list\n" + "\n\n".join(lines) + "\n\n"
        (Path(calibration_folder) / "images.txt").write_text(text)
    return root


def stem(file_name: str) -> str:
    return str(PurePosixPath(file_name).with_suffix(""))


def rows_of(evaluation: Path) -> list[dict[str, Any]]:
    """The rows of an evaluation folder."""
    text = (evaluation / "per_image.jsonl").read_text()
    return [json.loads(line) for line in text.splitlines()]


def plane(size_wh: tuple[int, int], seed: int = 0) -> NDArray[np.float64]:
    """A bumpy wall 2 to 9 m away, no pixel like another."""
    width, height = size_wh
    y, x = np.mgrid[:height, :width]
    noise = np.random.default_rng(seed).uniform(0, 0.5, (height, width))
    return 2.0 + 6.0 * (x / width + y / height) / 2 + noise
