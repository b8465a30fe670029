"""What a run holds of one submission: its surface and its render, as the run wrote them."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.read_depth import npz_arrays
from legoworld.errors import cause
from legoworld.evaluation.reconstruction.appearance import Picture, PictureError, decode_picture
from legoworld.evaluation.reconstruction.dataset import SubmissionFileError
from legoworld.evaluation.reconstruction.points import Depth, Raster
from legoworld.evaluation.run import Run, RunUnusableError, read_family_run
from legoworld.records.base import UNSET, RecordError, decode_lines
from legoworld.records.folders.read_run import ROWS
from legoworld.records.submission import BenchRow, RenderFile, SurfaceFile, WrittenFile
from legoworld.tasks.shipped import RECONSTRUCTION

_NO_TEXTURES: Final = np.zeros((0, 36, 64, 3), np.uint8)


@dataclass(frozen=True, kw_only=True)
class BenchRun:
    """A finished bench run. rows: ascending image id."""

    run: Run
    rows: tuple[BenchRow, ...]

    @property
    def kind(self) -> str:
        """Scene, or what made the submissions instead."""
        return str(self.run.configuration.kind or None)


@dataclass(frozen=True, kw_only=True)
class Surface:
    """The submitted surface at the scoring raster, see `records.submission`.

    own_depth_z_m, own_raster: with the submission's own intrinsics, None where those are the
    reference's; plane: (H, W), -1 where no camera-facing plane is; textures: (N, h, w, 3).
    """

    depth_z_m: Depth
    own_depth_z_m: Depth | None
    own_raster: Raster | None
    plane: NDArray[np.int16] | None
    textures: NDArray[np.uint8]


def read_bench_run(folder: Path) -> BenchRun:
    """A bench run and its rows. RunUnusableError or UsageError otherwise."""
    return bench_run(read_family_run(folder, RECONSTRUCTION, "a bench run"))


def bench_run(run: Run) -> BenchRun:
    """A run with its rows. RunUnusableError."""
    try:
        rows = decode_lines(BenchRow, (run.folder / ROWS).read_bytes())
    except (OSError, RecordError) as error:
        raise RunUnusableError(
            f"the run in {run.folder.name} cannot be read",
            found=cause(error),
            expected=f"{ROWS} as `legoworld readout --task bench` writes it",
        ) from error
    return BenchRun(run=run, rows=tuple(sorted(rows, key=lambda row: row.image_id)))


def list_files(folder: Path, rows: Sequence[BenchRow]) -> list[Path]:
    """Surfaces and renders that the rows name and that are there."""
    named = [file for row in rows for file in row_files(row)]
    return [path for file in named if (path := folder / str(file.file)).is_file()]


def row_files(row: BenchRow) -> list[WrittenFile]:
    """The files that a row names."""
    files: list[WrittenFile] = [f for f in (row.surface, row.render, row.probe) if f is not UNSET]
    seen = row.probe.render if row.probe is not UNSET else None
    return [*files, seen] if seen is not None else files


def load_surface(folder: Path, file: SurfaceFile, raster: Raster) -> Surface:
    """The surface of one submission. SubmissionFileError when it is not as the run wrote it."""
    data = _bytes(folder, file)
    try:
        arrays = npz_arrays(io.BytesIO(data), str(file.file))
        depth = _depth(arrays["depth_z_m"], raster)
        own = arrays.get("own_depth_z_m")
        return Surface(
            depth_z_m=depth,
            own_depth_z_m=None if own is None else _depth(own, raster),
            own_raster=None if own is None else _own_raster(arrays["own_intrinsics_px"], raster),
            plane=arrays.get("plane"),
            textures=arrays.get("textures", _NO_TEXTURES),
        )
    except (KeyError, ValueError, TypeError, DepthFileError) as error:
        raise SubmissionFileError(
            f"{file.file} cannot be used",
            found=f"{type(error).__name__}: {error}",
            expected=f"depth_z_m of {raster.width}x{raster.height}",
            next_step="run the readout again",
        ) from error


def load_arrays(folder: Path, file: WrittenFile) -> dict[str, NDArray[Any]]:
    """The arrays, of any shape, of a file that the run wrote. SubmissionFileError."""
    try:
        return npz_arrays(io.BytesIO(_bytes(folder, file)), str(file.file))
    except DepthFileError as error:
        raise SubmissionFileError(
            f"{file.file} cannot be used", found=cause(error), expected="an .npz of arrays"
        ) from error


def load_render(folder: Path, file: RenderFile) -> Picture:
    """The evaluator's (H, W, 3) render of one submission. SubmissionFileError."""
    data = _bytes(folder, file)
    try:
        picture = decode_picture(data)
    except PictureError as error:
        raise SubmissionFileError(
            f"{file.file} cannot be decoded", found=str(error), expected="a PNG"
        ) from error
    if picture.shape[1::-1] != file.size_wh:
        raise SubmissionFileError(
            f"{file.file} is of another size",
            found="{}x{}".format(*picture.shape[1::-1]),
            expected="{}x{}".format(*file.size_wh),
        )
    return picture


def _bytes(folder: Path, file: WrittenFile) -> bytes:
    try:
        data = (folder / file.file).read_bytes()
    except OSError as error:
        raise SubmissionFileError(
            f"{file.file} cannot be read",
            found=cause(error),
            expected="the file that the run wrote",
            next_step="run the readout again",
        ) from error
    digest = hashlib.sha256(data).hexdigest()
    if digest != file.sha256:
        raise SubmissionFileError(
            f"{file.file} is not the one the run wrote",
            found=digest[:12],
            expected=file.sha256[:12],
            next_step="run the readout again",
        )
    return data


def _depth(array: NDArray[Any], raster: Raster) -> Depth:
    if array.shape != (raster.height, raster.width):
        raise ValueError(f"depth of shape {array.shape}")
    return np.ascontiguousarray(array, np.float32)


def _own_raster(intrinsics_px: NDArray[Any], raster: Raster) -> Raster:
    fx, fy, cx, cy = (float(x) for x in intrinsics_px)
    return Raster(fx=fx, fy=fy, cx=cx, cy=cy, width=raster.width, height=raster.height)
