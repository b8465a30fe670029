"""Depth arrays with their labels: what the .npz says of itself, or what a folder declares."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.depth.arrays import DepthArray, Intrinsics, checked_array
from legoworld.evaluation.depth.declaration import DECLARATION, Declaration
from legoworld.evaluation.depth.errors import DepthFileError
from legoworld.evaluation.depth.integer_units import metres
from legoworld.evaluation.depth.pictures import read_npz, read_picture

#: A readout's array: planar z in metres by its name.
DEPTH_Z_M: Final = "depth_z_m"
VALUES: Final = "values"
_LABELS: Final = ("space", "unit", "intrinsics_px")


def read_labelled(path: Path, declared: Declaration) -> DepthArray:
    """A depth file of any accepted format. DepthFileError says why it cannot be used.

    An .npz carries its own labels: an array `depth_z_m` with space "depth" (a readout's), or
    `values` with `space`, `unit` (absent or "" when unknown) and, for ray_distance,
    `intrinsics_px` = fx, fy, cx, cy. Every other format has what was declared of it.
    """
    if path.suffix.lower() == ".npz":
        return _read_npz(path, declared)
    values = read_picture(path)
    return _array(values, declared.space, declared.unit, declared.intrinsics_px, declared, path)


def _read_npz(path: Path, declared: Declaration) -> DepthArray:
    candidates = (declared.array,) if declared.array else (DEPTH_Z_M, VALUES)
    arrays, names = read_npz(path, {*candidates, *_LABELS})
    found = [name for name in candidates if name in arrays]
    if len(found) != 1:
        raise DepthFileError(
            f"{path.name} does not have one depth array",
            found=", ".join(names) or "no arrays",
            expected=" or ".join(str(c) for c in candidates),
            next_step=f'name it in {DECLARATION}: array = "..."',
        )
    space = _agreed("space", _text(arrays, "space", path), declared.space, path)
    unit = _agreed("unit", _text(arrays, "unit", path), declared.unit, path)
    if found[0] == DEPTH_Z_M:
        _agreed("space", space or None, "depth" if space else None, path)
        unit = _agreed("unit", unit, "m", path)
    intrinsics = _intrinsics(arrays, path) or declared.intrinsics_px
    return _array(arrays[found[0]], space, unit, intrinsics, declared, path)


def _array(
    values: NDArray[Any],
    space: str | None,
    unit: str | None,
    intrinsics_px: Intrinsics | None,
    declared: Declaration,
    path: Path,
) -> DepthArray:
    if values.dtype.kind in "iu":
        values = metres(values, unit, invalid_value=declared.invalid_value, source=path.name)
        unit = "m"
    return checked_array(
        values, space=space, unit=unit, intrinsics_px=intrinsics_px, source=path.name
    )


def _text(arrays: dict[str, NDArray[Any]], name: str, path: Path) -> str | None:
    """A text stored as a 0-d array; None when absent or empty."""
    if name not in arrays:
        return None
    if arrays[name].ndim != 0 or arrays[name].dtype.kind != "U":
        raise DepthFileError(
            f"{path.name}: {name} is no text",
            found=f"{arrays[name].dtype}, shape {arrays[name].shape}",
            expected="a 0-d string array",
        )
    return str(arrays[name]) or None


def _agreed(name: str, own: str | None, other: str | None, path: Path) -> str | None:
    """What a file says of itself and what is said of it, when they are the same."""
    if own is not None and other is not None and own != other:
        raise DepthFileError(
            f"{path.name} is labelled in two ways",
            found=f"{name} {own!r} and {other!r}",
            expected="one",
        )
    return own if own is not None else other


def _intrinsics(arrays: dict[str, NDArray[Any]], path: Path) -> Intrinsics | None:
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
