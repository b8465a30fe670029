"""Runs of normals and truth folders, written the way readouts and datasets write them."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.family import EvaluationRequest
from legoworld.evaluation.normals.family import EVALUATION
from legoworld.evaluation.run import read_run
from legoworld.readouts.normals import NORMALS_FILE

Arrays = dict[str, NDArray[Any]]


def evaluate(run: Path, truth: Path, output: Path, **others: Any) -> Any:
    request = EvaluationRequest(run=read_run(run), truth=truth, output=output, draws=200, **others)
    return EVALUATION.evaluate(request)


def write_run(folder: Path, arrays: Arrays, *, kind: str = "scene") -> Path:
    """A finished run of photos by file name; an empty array is an image that failed."""
    rows = []
    for image_id, (name, values) in enumerate(arrays.items(), start=1):
        file = NORMALS_FILE.path(Path(name).stem)
        row: dict[str, Any] = {"image_id": image_id, "file_name": name, "scene": Path(name).stem}
        if not values.size:
            rows.append({**row, "status": "invalid", "reason": "it was broken"})
            continue
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        NORMALS_FILE.write(folder / file, values.astype(np.float32), {})
        data = (folder / file).read_bytes()
        written = {"file": file, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
        rows.append({**row, "status": "ok", "reason": None, "normals": written})
    configuration = {"task": "normals", "kind": kind, "attempted": len(rows), "partial": False}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "run.json").write_text(json.dumps({"configuration": configuration, "scenes": {}}))
    (folder / "per_image.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows))
    return folder


def write_truth(folder: Path, arrays: Arrays, sign: str | None = "towards_camera") -> Path:
    """A truth folder of .npy files, declared by normals.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, values in arrays.items():
        np.save(folder / f"{Path(name).stem}.npy", values)
    if sign is not None:
        (folder / "normals.toml").write_text(f'sign = "{sign}"\n')
    return folder


def wall(size_wh: tuple[int, int], degrees: float = 0.0) -> NDArray[np.float64]:
    """A wall that is turned about the vertical axis."""
    angle = np.radians(degrees)
    vector = [np.sin(angle), 0.0, -np.cos(angle)]
    return np.broadcast_to(vector, (*size_wh[::-1], 3)).copy()
