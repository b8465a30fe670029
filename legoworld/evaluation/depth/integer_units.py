"""16-bit integers of depth cameras, in the declared unit of each file."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.evaluation.pixels.family import F64
from legoworld.pluralize import plural

_SATURATED: Final = 65535


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


#: Units that are written 1 / N of a metre, such as m/5000.
_PARTS: Final = "m/"


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

#: The units of a depth, for messages: the last two are of integers only.
UNITS: Final = "m | mm | m/N, such as m/5000 | sun_rgbd | nyu_raw"


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
