"""Depth: one uncompressed .npz per photo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from legoworld.files import sha256_of_file
from legoworld.readouts.family import AnsweredImage, ReadoutFamily, unusable_row
from legoworld.readouts.pixels import PixelFile
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import DepthFile, RunRow
from legoworld.visibility.projection import Projection

#: Version 2 adds `format_version` and `intrinsics_px` to version 1's array and space.
DEPTH_FILE: Final = PixelFile(
    folder="depth", array="depth_z_m", labels={"space": "depth"}, version=2, hole=np.inf
)


def write_depth(
    path: Path, depth_z_m: NDArray[np.float32], projection: Projection | None = None
) -> None:
    """Write (H, W) float32 planar depth in metres, +inf where nothing is hit.

    projection: the projection of the array, at its size. A perspective projection is stored as
    `intrinsics_px` = fx, fy, cx, cy (float64, pixels, origin at the top left corner of the top left
    pixel: u = fx x / z + cx); an orthographic one has no intrinsics.
    """
    others: dict[str, NDArray[Any]] = {}
    if projection is not None and not projection.orthographic:
        p = projection
        others["intrinsics_px"] = np.array([p.fx, p.fy, p.cx, p.cy], np.float64)
    DEPTH_FILE.write(path, depth_z_m, others)


def _write(row: RunRow, image: AnsweredImage) -> RunRow:
    name = DEPTH_FILE.path(image.name)
    path, depth_z_m = image.run / name, image.view.buffers.depth_z_m
    write_depth(path, depth_z_m, image.view.projection)
    file = DepthFile(
        file=name,
        space=DEPTH_FILE.labels["space"],
        unit="m",
        bytes=path.stat().st_size,
        sha256=sha256_of_file(path),
        finite_px=int(np.isfinite(depth_z_m).sum()),
    )
    return structs.replace(row, depth=file)


def _sum_up(summary: RunSummary, _rows: Sequence[RunRow], ok: Sequence[RunRow]) -> RunSummary:
    return structs.replace(summary, depth_bytes=sum(_depth_bytes(row) for row in ok))


def _depth_bytes(row: RunRow) -> int:
    if not row.depth:
        raise unusable_row(row, "depth")
    return row.depth.bytes


READOUT: Final = ReadoutFamily(
    write=_write,
    sum_up=_sum_up,
    file_bytes=DEPTH_FILE.most_bytes,
    needs_instances=False,
    array=lambda image: image.view.buffers.depth_z_m,
)
