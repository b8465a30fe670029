"""Depth cameras' 16-bit integers, each in the unit its file was declared to have."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.depth.alignment import F64
from legoworld.evaluation.depth.errors import DepthFileError

_SATURATED: Final = 65535


def _per_metre(count: float) -> Callable[[NDArray[np.uint16]], F64]:
    return lambda stored: stored.astype(np.float64) / count


def _sun_rgbd(stored: NDArray[np.uint16]) -> F64:
    """SUN RGB-D keeps millimetres rotated left by 3 bits (its toolbox's read3dPoints.m)."""
    rotated = (stored >> np.uint16(3)) | (stored << np.uint16(13))
    return rotated.astype(np.float64) / 1000.0


def _nyu_raw(stored: NDArray[np.uint16]) -> F64:
    """Raw Kinect disparity of NYU Depth v2's PGMs: z = 351.3 / (1092.5 - raw), 2047 is nothing.

    The files keep the low byte first, against the PGM standard, so a standard reader gets each
    number with its bytes swapped (the dataset's own toolbox swaps them back, too).
    """
    return 351.3 / (1092.5 - stored.byteswap().astype(np.float64))


#: Declared unit -> metres. 0 is "no depth" in all of them but nyu_raw, where a depth
#: that is not positive is.
INTEGER_UNITS: Final[dict[str, Callable[[NDArray[np.uint16]], F64]]] = {
    "mm": _per_metre(1000.0),
    "m/256": _per_metre(256.0),
    "m/5000": _per_metre(5000.0),
    "sun_rgbd": _sun_rgbd,
    "nyu_raw": _nyu_raw,
}


def metres(
    stored: NDArray[Any], unit: str | None, *, invalid_value: int | None, source: str
) -> F64:
    """(H, W) uint16 as float64 metres; invalid_value, if any, becomes inf.

    DepthFileError when the unit is not declared, the type is not uint16, or a pixel holds 65535:
    a writer that clips leaves that, and 65.535 m is all that millimetres can say. (A writer that
    wraps around leaves no trace; such files cannot be told from good ones.)
    """
    if stored.dtype != np.uint16 or stored.ndim != 2:
        raise DepthFileError(
            f"{source} is no 16-bit depth image",
            found=f"{stored.dtype}, shape {stored.shape}",
            expected="one channel of uint16",
            next_step="8-bit and colour pictures are for viewing; use the measured depth",
        )
    if unit not in INTEGER_UNITS:
        raise DepthFileError(
            f"{source} holds integers of no declared unit",
            found=f"unit {unit!r}",
            expected=" | ".join(INTEGER_UNITS),
            next_step='declare it in depth.toml, such as unit = "mm"',
        )
    unknown = stored == invalid_value if invalid_value is not None else np.zeros(1, np.bool_)
    saturated = int(np.count_nonzero((stored == _SATURATED) & ~unknown))
    if saturated:
        raise DepthFileError(
            f"{source} is clipped: the scene goes beyond what 16 bits hold",
            found=f"{saturated} pixels of {_SATURATED}",
            expected=f"values below {_SATURATED}",
            next_step=f"store float32, or declare invalid_value = {_SATURATED} if it means none",
        )
    depth_m = INTEGER_UNITS[unit](stored)
    if invalid_value is not None:
        depth_m[unknown] = np.inf
    return depth_m
