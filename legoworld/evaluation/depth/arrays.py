"""Depth arrays with their declared quantity, their disparity at single pixels, and their errors.

depth.toml declares the arrays of a folder whose files cannot declare it themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.errors import LegoWorldError
from legoworld.evaluation.pixels.family import F64, Index, Mask, PixelArray, Stored, pixel_errors
from legoworld.evaluation.pixels.labelled import is_text, read_declared
from legoworld.files import Json

DepthTruthError, DepthPredictionError, DepthMissingError, DepthUnseenError = ERRORS = pixel_errors(
    "depth", __name__
)
DECLARATION: Final = "depth.toml"


class CameraModelError(LegoWorldError):
    """A camera model is unknown, or has no ray for a pixel."""

    code = "camera_model"


Space = Literal["depth", "disparity", "ray_distance"]
SPACES: Final[tuple[Space, ...]] = get_args(Space)
Intrinsics = tuple[float, float, float, float]
#: The sum of squares of an image of such values is still finite in float64.
_LARGEST: Final = 1e150


@dataclass(frozen=True, kw_only=True)
class DepthArray(PixelArray):
    """(H, W) float32 or float64 values and their declared quantity.

    space: "depth" is planar z, "ray_distance" the distance from the camera's centre, "disparity"
    anything affine in 1 / z. unit: of the values, None when they have no known scale.
    intrinsics_px: fx, fy, cx, cy at this array's size, origin at the top left corner of the top
    left pixel; ray distance cannot be turned into depth without them.
    """

    space: Space
    unit: str | None
    intrinsics_px: Intrinsics | None

    def at(self, rows: Index, cols: Index) -> tuple[F64, Mask]:
        """Disparity at pixels (n,), 0 where there is no prediction, and a mask of predictions.

        A depth or distance is a prediction if finite and positive; a disparity if finite, because
        it is fitted with a free shift and its sign has no meaning. A value whose square, or whose
        inverse's square, overflows float64 is not a prediction.
        """
        values = self.values[rows, cols].astype(np.float64)
        predicted = self.prediction_mask(values)
        if self.space == "disparity":
            return np.where(predicted, values, 0.0), predicted
        disparity = np.zeros_like(values)
        np.divide(1.0, values, out=disparity, where=predicted)
        if self.space == "ray_distance":
            disparity *= self._ray_lengths(rows, cols)
        return disparity, predicted

    def prediction_mask(self, values: NDArray[Any]) -> Mask:
        """Mask of the values that are predictions, of the same shape."""
        return in_range(values, signed=self.space == "disparity")

    def _ray_lengths(self, rows: Index, cols: Index) -> F64:
        """Ray distance over planar z at pixel centres."""
        assert self.intrinsics_px is not None
        return ray_lengths(self.intrinsics_px, rows, cols)


def in_range(values: NDArray[Any], *, signed: bool) -> Mask:
    """Where values are finite, positive unless signed, and can be squared in float64; any shape."""
    usable: Mask = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        if not signed:
            usable &= values > 0
        if values.dtype.itemsize > 4:  # float32 ends far below: its numbers and inverses all fit
            size = np.abs(values)
            usable &= (size <= _LARGEST) & (signed | (size >= 1.0 / _LARGEST))
    return usable


def ray_lengths(intrinsics_px: Intrinsics, rows: Index, cols: Index) -> F64:
    """sqrt(1 + x^2 + y^2) of the rays with planar z 1 through pixel centres; shapes broadcast."""
    fx, fy, cx, cy = intrinsics_px
    x = (cols + 0.5 - cx) / fx
    y = (rows + 0.5 - cy) / fy
    lengths: F64 = np.sqrt(1.0 + x * x + y * y)
    return lengths


def checked_array(
    values: NDArray[Any],
    *,
    space: Json,
    unit: str | None,
    intrinsics_px: Intrinsics | None,
    source: str,
    stored: Stored | None = None,
) -> DepthArray:
    """(H, W) depth after all checks that need no other file. DepthFileError if any fails."""
    if space not in SPACES:
        raise DepthFileError(
            f"{source} does not say what its numbers are",
            found=f"space {space!r}",
            expected=" | ".join(SPACES),
            next_step="declare it: a disparity scored as a depth gives a plausible wrong number",
        )
    if values.ndim != 2 or not values.size:
        raise DepthFileError(
            f"{source} is not one depth image",
            found=f"shape {values.shape}",
            expected="(height, width)",
        )
    if values.dtype.kind != "f" or values.dtype.itemsize not in (4, 8):
        raise DepthFileError(
            f"{source} has the wrong number type",
            found=str(values.dtype),
            expected="float32 or float64 (float16 keeps 3 digits and overflows at 65504)",
        )
    if space == "ray_distance" and intrinsics_px is None:
        raise DepthFileError(
            f"{source} contains ray distances but no intrinsics",
            found="no intrinsics_px",
            expected="fx, fy, cx, cy at the array's size",
            next_step="give --intrinsics when importing",
        )
    if intrinsics_px is not None and not _usable(intrinsics_px):
        raise DepthFileError(
            f"{source} has intrinsics that cannot be used",
            found=str(intrinsics_px),
            expected="finite fx, fy, cx, cy with positive focal lengths",
        )
    return DepthArray(
        values=values, space=space, unit=unit, intrinsics_px=intrinsics_px, stored=stored
    )


def _usable(intrinsics_px: Intrinsics) -> bool:
    return bool(np.all(np.isfinite(intrinsics_px))) and min(intrinsics_px[:2]) > 0


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """The declared content of a ground-truth folder's files; None where undeclared.

    space: depth | ray_distance | disparity; unit: m, mm or m/N of floats, mm, m/N, sun_rgbd or
    nyu_raw of 16-bit integers, px of a disparity; array: the name inside an .npz or .exr;
    intrinsics_px: fx, fy, cx, cy for ray_distance; focal_px, baseline_m, doffs_px: z = focal *
    baseline / (d + doffs) of a disparity; invalid_value: the integer that means "nothing
    measured", besides 0.
    """

    space: str | None = None
    unit: str | None = None
    array: str | None = None
    intrinsics_px: Intrinsics | None = None
    focal_px: float | None = None
    baseline_m: float | None = None
    doffs_px: float | None = None
    invalid_value: int | None = None


def read_declaration(folder: Path) -> Declaration:
    """The folder's depth.toml; an empty declaration without one. DepthTruthError if invalid."""
    values = read_declared(
        folder / DECLARATION,
        _FITS,
        expected=", ".join(sorted(_FITS)) + "; space " + " | ".join(SPACES),
        error=DepthTruthError,
    )
    if "intrinsics_px" in values:
        values["intrinsics_px"] = tuple(float(x) for x in values["intrinsics_px"])
    return Declaration(**values)


def _is_number(value: Json) -> bool:
    try:
        return isinstance(value, int | float) and type(value) is not bool and math.isfinite(value)
    except OverflowError:  # an integer that no float holds
        return False


_FITS: Final[dict[str, Callable[[Json], bool]]] = {
    "space": lambda value: value in SPACES,
    "unit": is_text,
    "array": is_text,
    "intrinsics_px": lambda value: (
        isinstance(value, list) and len(value) == 4 and all(map(_is_number, value))
    ),
    **dict.fromkeys(("focal_px", "baseline_m", "doffs_px"), _is_number),
    "invalid_value": lambda value: type(value) is int and 0 <= value <= 65535,
}
