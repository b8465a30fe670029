"""Depth arrays with their declarations, from the .npz itself or from the folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import SizeCheck, picture_shape
from legoworld.depth_files.read_depth import npz_contents, read_npz_array, read_picture
from legoworld.evaluation.depth.arrays import DepthArray, Intrinsics, checked_array
from legoworld.evaluation.depth.declaration import DECLARATION, Declaration
from legoworld.evaluation.depth.integer_units import metres
from legoworld.evaluation.pixels.family import Stored
from legoworld.evaluation.pixels.labelled import (
    check_version,
    fits_into_memory,
    merge_declarations,
    picture_name,
    text_label,
)
from legoworld.readouts.depth import DEPTH_FILE

VALUES: Final = "values"
_LABELS: Final = ("space", "unit", "intrinsics_px", "format_version")


def read_labelled(
    path: Path,
    declared: Declaration,
    *,
    check_size: SizeCheck | None = None,
    accept_float16: bool = False,
) -> DepthArray:
    """Read a depth file of any accepted format. DepthFileError if it is unusable.

    An .npz declares itself: an array `depth_z_m` with space "depth" (a readout's), or `values` with
    `space` and `unit` (absent or "" if unknown); both may have `intrinsics_px` = fx, fy, cx, cy,
    which ray_distance needs. Every other format uses the given declaration. Axes of length 1 around
    the image's two are dropped. check_size: called with the header's size before the array is read.
    accept_float16: convert float16 to float32.
    """
    with fits_into_memory(path):
        if path.suffix.lower() == ".npz":
            return _read_npz(path, declared, check_size, accept_float16)
        values, channel = read_picture(path, channel=declared.array, check_size=check_size)
        return _array(_Labels.of(declared), values, channel, declared, path, accept_float16)


def read_prediction(path: Path, check_size: SizeCheck | None) -> DepthArray:
    """A file of a run, which declares itself. The same errors."""
    return read_labelled(path, Declaration(), check_size=check_size)


@dataclass(frozen=True, kw_only=True)
class _Labels:
    space: str | None
    unit: str | None
    intrinsics_px: Intrinsics | None

    @classmethod
    def of(cls, declared: Declaration) -> _Labels:
        return cls(space=declared.space, unit=declared.unit, intrinsics_px=declared.intrinsics_px)


def _read_npz(
    path: Path, declared: Declaration, check_size: SizeCheck | None, accept_float16: bool
) -> DepthArray:
    contents = npz_contents(path, _LABELS)
    candidates = (declared.array,) if declared.array else (DEPTH_FILE.array, VALUES)
    name = picture_name(path, contents, candidates, "depth", DECLARATION)
    own = contents.labels
    check_version(own, path, DEPTH_FILE.version)
    space = merge_declarations("space", text_label(own, "space", path), declared.space, path)
    unit = merge_declarations("unit", text_label(own, "unit", path), declared.unit, path)
    if name == DEPTH_FILE.array:
        merge_declarations("space", space or None, "depth" if space else None, path)
        unit = merge_declarations("unit", unit, "m", path)
    intrinsics = _intrinsics(own, path) or declared.intrinsics_px
    values = read_npz_array(path, name, check_size)
    labels = _Labels(space=space, unit=unit, intrinsics_px=intrinsics)
    return _array(labels, values, name, declared, path, accept_float16)


def _array(
    labels: _Labels,
    values: NDArray[Any],
    name: str | None,
    declared: Declaration,
    path: Path,
    accept_float16: bool,
) -> DepthArray:
    stored = Stored(array=name, dtype=str(values.dtype), shape=values.shape)
    values = values.reshape(picture_shape(values.shape))
    if not values.dtype.isnative:  # numpy keeps the byte order of the machine that wrote the file
        values = values.astype(values.dtype.newbyteorder("="))
    unit = labels.unit
    if values.dtype.kind in "iu":
        values = metres(values, unit, invalid_value=declared.invalid_value, source=path.name)
        unit = "m"
    if accept_float16 and values.dtype == np.float16:
        values = values.astype(np.float32)
    return checked_array(
        values,
        space=labels.space,
        unit=unit,
        intrinsics_px=labels.intrinsics_px,
        source=path.name,
        stored=stored,
    )


def _intrinsics(arrays: Mapping[str, NDArray[Any]], path: Path) -> Intrinsics | None:
    if "intrinsics_px" not in arrays:
        return None
    values = arrays["intrinsics_px"]
    if values.shape != (4,) or values.dtype.kind not in "fiu":
        raise DepthFileError(
            f"{path.name}: intrinsics_px cannot be used",
            found=f"{values.dtype}, shape {values.shape}",
            expected="fx, fy, cx, cy",
        )
    fx, fy, cx, cy = (float(x) for x in np.asarray(values, np.float64))
    return fx, fy, cx, cy
