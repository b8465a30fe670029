"""Depth arrays into the run folder: labelled, whole or not at all, and hashed."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Space = Literal["depth", "disparity", "ray_distance"]


def write_depth(
    request: dict[str, Any],
    image: dict[str, Any],
    values: NDArray[Any],
    space: Space,
    unit: str | None,
) -> dict[str, Any]:
    """Write one image's (H, W) array and return the result that `predict` gives back.

    values: float32 at any size (the scorer resamples); NaN or +inf where there is no prediction.
    space: depth (planar z), disparity (affine in 1 / z) or ray_distance; unit: "m", or None where
    the scale is unknown. ValueError for another shape, type or label.
    """
    if values.ndim != 2 or not values.size or values.dtype != np.float32:
        raise ValueError(f"depth is (H, W) float32, not {values.shape} {values.dtype}")
    if space not in ("depth", "disparity", "ray_distance"):
        raise ValueError(f"there is no depth space {space!r}")
    stem = PurePosixPath(image["file_name"]).with_suffix("")
    name = f"depth/{stem}.npz"
    path = Path(request["output"]) / name
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as stream:
            np.savez(stream, values=values, space=np.array(space), unit=np.array(unit or ""))
        digest = hashlib.sha256(temporary.read_bytes()).hexdigest()
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    height, width = values.shape
    return {
        "depth": {
            "file": name,
            "sha256": digest,
            "size_wh": [width, height],
            "space": space,
            "unit": unit,
        }
    }
