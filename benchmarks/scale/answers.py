"""What the right answer of each scale scene is, and how far a run is from it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

#: float32 depth, and a little for the projection.
_RELATIVE = 2e-7


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene of `build.py`, the task that shows its answer, and the check of that run.

    check: run folder to a line that says what was confirmed; AssertionError otherwise.
    """

    name: str
    task: str
    check: Callable[[Path], str]


def _grid_of_boxes(run: Path, grid_wh: tuple[int, int], cell: int, box: list[int]) -> str:
    columns, rows = grid_wh
    predictions = json.loads((run / "predictions.json").read_text())
    found = sorted(tuple(p["bbox"]) for p in predictions)
    left, top, width, height = box
    expected = sorted(
        (cell * c + left, cell * r + top, width, height)
        for r in range(rows)
        for c in range(columns)
    )
    assert found == expected, f"{len(found)} boxes, {len(set(found) & set(expected))} as expected"
    return f"{len(found):,} instances, every box exact"


def _masks_of_cells(run: Path) -> str:
    from pycocotools import mask as coco_mask

    predictions = json.loads((run / "predictions.json").read_text())
    masks = [p["segmentation"] for p in predictions]
    assert len({m["counts"] for m in masks}) == 70_000, "two instances have the same mask"
    areas = coco_mask.area(masks)
    assert (areas == 4).all(), f"areas {sorted(set(areas.tolist()))}"
    return "70,000 distinct masks of 4 px"


def _depth(run: Path) -> NDArray[np.float32]:
    files = list((run / "depth").rglob("*.npz"))
    assert len(files) == 1
    depth: NDArray[np.float32] = np.load(files[0])["depth_z_m"]
    return depth


def _plane(run: Path, distance_m: float) -> str:
    depth = _depth(run)
    worst = float(np.abs(depth / distance_m - 1).max())
    assert worst <= _RELATIVE, f"worst relative error {worst:g}"
    return f"{distance_m:g} m at every pixel (worst relative error {worst:.1e})"


def _room(run: Path) -> str:
    depth = _depth(run).astype(np.float64)
    height, width = depth.shape
    u = np.abs(np.arange(width) + 0.5 - width / 2)
    v = np.abs(np.arange(height) + 0.5 - height / 2)
    focal_px = width  # lens and sensor are both 36 mm
    walls = np.minimum(2.0 * focal_px / u[None, :], 1.5 * focal_px / v[:, None])
    expected = np.minimum(walls, 6.0)
    # Float32 vertices of slivers: a wall's own corners are off by half a step of 2.0.
    worst = float(np.abs(depth / expected - 1).max())
    assert worst <= _RELATIVE, f"worst relative error {worst:g}"
    return f"every wall at its distance (worst relative error {worst:.1e})"


CASES = (
    Case(name="objects_70k", task="coco",
         check=lambda run: _grid_of_boxes(run, (280, 250), 4, [1, 1, 2, 2])),
    Case(name="objects_70k", task="lvis", check=_masks_of_cells),
    Case(name="placements_10k", task="coco",
         check=lambda run: _grid_of_boxes(run, (100, 100), 8, [1, 1, 6, 6])),
    Case(name="mesh_5m", task="eth3d", check=lambda run: _plane(run, 5.0)),
    Case(name="near_plane_room", task="eth3d", check=_room),
    Case(name="millimetres", task="eth3d", check=lambda run: _plane(run, 5.0)),
    Case(name="kilometres", task="eth3d", check=lambda run: _plane(run, 5000.0)),
    Case(name="far_from_origin", task="eth3d", check=lambda run: _plane(run, 5.0)),
)  # fmt: skip
