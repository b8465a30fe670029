"""Depth: one uncompressed .npz per photo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from legoworld.files import sha256_of_file, write_npz
from legoworld.readouts.family import AnsweredImage, ReadoutFamily, unusable_row
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import DepthFile, RunRow
from legoworld.visibility.projection import Projection

#: Version of the .npz: 2 adds `format_version` and `intrinsics_px` to version 1's array and space.
FORMAT_VERSION: Final = 2
#: Overhead of one .npz in bytes: zip headers and the space's name, rounded up.
_CONTAINER_BYTES = 4096


def depth_file(scene: str) -> str:
    """Path of a photo's depth file, relative to the run; `scene`: its path without extension."""
    return f"depth/{scene}.npz"


def write_depth(
    path: Path, depth_z_m: NDArray[np.float32], projection: Projection | None = None
) -> None:
    """Write (H, W) float32 planar depth in metres, +inf where nothing is hit.

    projection: the projection of the array, at its size. A perspective projection is stored as
    `intrinsics_px` = fx, fy, cx, cy (float64, pixels, origin at the top left corner of the top left
    pixel: u = fx x / z + cx); an orthographic one has no intrinsics.
    """
    arrays: dict[str, NDArray[Any]] = {
        "depth_z_m": depth_z_m,
        "space": np.array("depth"),
        "format_version": np.array(FORMAT_VERSION),
    }
    if projection is not None and not projection.orthographic:
        p = projection
        arrays["intrinsics_px"] = np.array([p.fx, p.fy, p.cx, p.cy], np.float64)
    write_npz(path, arrays)


def depth_file_bytes(size_wh: tuple[int, int]) -> int:
    """Upper bound of the size of a photo's depth file, in bytes."""
    return 4 * size_wh[0] * size_wh[1] + _CONTAINER_BYTES


def _write(row: RunRow, image: AnsweredImage) -> RunRow:
    name = depth_file(image.name)
    path, depth_z_m = image.run / name, image.view.buffers.depth_z_m
    write_depth(path, depth_z_m, image.view.projection)
    file = DepthFile(
        file=name,
        space="depth",
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
    write=_write, sum_up=_sum_up, file_bytes=depth_file_bytes, needs_instances=False
)
