"""Depth arrays with their declarations, from the .npz itself or from the folder.

16-bit integers of depth cameras become metres by the declared unit of each file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import SizeCheck, picture_shape
from legoworld.depth_files.read_depth import npz_contents, read_npz_array, read_picture
from legoworld.evaluation.depth.arrays import (
    DECLARATION,
    Declaration,
    DepthArray,
    Intrinsics,
    checked_array,
)
from legoworld.evaluation.pixels.family import F64, Stored
from legoworld.evaluation.pixels.labelled import (
    check_version,
    fits_into_memory,
    merge_declarations,
    picture_name,
    text_label,
)
from legoworld.pluralize import plural
from legoworld.readouts.depth import DEPTH_FILE

_SATURATED: Final = 65535
#: Units that are written 1 / N of a metre, such as m/5000.
_PARTS: Final = "m/"
#: The units of a depth, for messages: the last two are of integers only.
UNITS: Final = "m | mm | m/N, such as m/5000 | sun_rgbd | nyu_raw"
VALUES: Final = "values"
_LABELS: Final = ("space", "unit", "intrinsics_px", "format_version")


def _sun_rgbd(stored: NDArray[np.uint16]) -> F64:
    """SUN RGB-D keeps millimetres rotated left by 3 bits (its toolbox's read3dPoints.m)."""
    rotated = (stored >> np.uint16(3)) | (stored << np.uint16(13))
    return rotated.astype(np.float64) / 1000.0


def _nyu_raw(stored: NDArray[np.uint16]) -> F64:
    """Raw Kinect disparity of NYU Depth v2's PGMs: z = 351.3 / (1092.5 - raw), 2047 is invalid.

    The files keep the low byte first, against the PGM standard, so a standard reader gets each
    number with its bytes swapped (the dataset's own toolbox swaps them back, too).
    """
    return 351.3 / (1092.5 - stored.byteswap().astype(np.float64))


def per_metre(unit: str | None) -> float | None:
    """Units per metre: for m, mm, or m/N with any N; None for other units."""
    if unit in ("m", "mm"):
        return 1.0 if unit == "m" else 1000.0
    try:
        count = float(unit.removeprefix(_PARTS)) if unit and unit.startswith(_PARTS) else 0.0
    except ValueError:
        return None
    return count if count > 0 and math.isfinite(count) else None


#: Units that are more than a scale -> metres. 0 is "no depth" in all units but nyu_raw, where a
#: depth that is not positive is.
_CODED: Final[dict[str, Callable[[NDArray[np.uint16]], F64]]] = {
    "sun_rgbd": _sun_rgbd,
    "nyu_raw": _nyu_raw,
}


def is_unit(unit: str) -> bool:
    """Whether the text is a unit of depth."""
    return per_metre(unit) is not None or unit in _CODED


def metres(
    stored: NDArray[Any], unit: str | None, *, invalid_value: int | None, source: str
) -> F64:
    """(H, W) uint16 as float64 metres; invalid_value, if any, becomes inf.

    DepthFileError if the unit is not declared, the type is not uint16, or a pixel is 65535: clipped
    values end there, since 16-bit millimetres end at 65.535 m. (Values that wrapped around cannot
    be detected.)
    """
    if stored.dtype != np.uint16 or stored.ndim != 2:
        raise DepthFileError(
            f"{source} is not a 16-bit depth image",
            found=f"{stored.dtype}, shape {stored.shape}",
            expected="one channel of uint16",
            next_step="8-bit and colour images are for viewing; use the measured depth",
        )
    count = per_metre(unit) if unit != "m" else None  # whole metres are m/1: say so
    if unit not in _CODED and count is None:
        raise DepthFileError(
            f"{source} contains integers without a declared unit",
            found=f"unit {unit!r}",
            expected=UNITS,
            next_step='declare it in depth.toml, such as unit = "mm"',
        )
    unknown = stored == invalid_value if invalid_value is not None else np.zeros(1, np.bool_)
    saturated = int(np.count_nonzero((stored == _SATURATED) & ~unknown))
    if saturated:
        raise DepthFileError(
            f"{source} is clipped: the scene exceeds the range of 16 bits",
            found=f"{plural(saturated, 'pixel', 'pixels')} of {_SATURATED}",
            expected=f"values below {_SATURATED}",
            next_step=f"store float32, or declare invalid_value = {_SATURATED} if it means none",
        )
    depth_m = stored.astype(np.float64) / count if count else _CODED[str(unit)](stored)
    if invalid_value is not None:
        depth_m[unknown] = np.inf
    return depth_m


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
        return _array(declared, values, channel, path, accept_float16)


def read_prediction(path: Path, check_size: SizeCheck | None) -> DepthArray:
    """A file of a run, which declares itself. The same errors."""
    return read_labelled(path, Declaration(), check_size=check_size)


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
    labels = replace(declared, space=space, unit=unit, intrinsics_px=intrinsics)
    return _array(labels, values, name, path, accept_float16)


def _array(
    labels: Declaration, values: NDArray[Any], name: str | None, path: Path, accept_float16: bool
) -> DepthArray:
    stored = Stored(array=name, dtype=str(values.dtype), shape=values.shape)
    values = values.reshape(picture_shape(values.shape))
    if not values.dtype.isnative:  # numpy keeps the byte order of the machine that wrote the file
        values = values.astype(values.dtype.newbyteorder("="))
    unit = labels.unit
    if values.dtype.kind in "iu":
        values = metres(values, unit, invalid_value=labels.invalid_value, source=path.name)
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
