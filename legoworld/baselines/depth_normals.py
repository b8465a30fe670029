"""Normals fitted to depth: what a depth network, or any depth, says about surfaces."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.baselines.depth_folder import DepthDeclarations, planar_depth
from legoworld.depth_files.errors import DepthFileError
from legoworld.evaluation.depth.arrays import DepthArray, Intrinsics
from legoworld.evaluation.normals.arrays import TOWARDS, NormalsArray
from legoworld.evaluation.pixels.family import F64, Mask
from legoworld.tracks.track import TrackImage

#: Pixels on each side of the one whose plane is fitted: 5 x 5.
_RADIUS: Final = 2
#: A neighbour is of the same surface when its inverse depth differs by no more than this share of
#: the pixel's, or the mean of it and the one opposite by no more than that.
_SAME_SURFACE: Final = 0.05
_STRAIGHT: Final = 0.0025
_BAND_ROWS: Final = 256
_FEWEST: Final = 6


def fit_normals(source: DepthDeclarations, path: Path, image: TrackImage) -> NormalsArray:
    """A photo's normals, fitted to its depth. DepthFileError if that is unusable or has no camera.

    Normals do not depend on the unit. A disparity is taken as 1 / z times a scale: its unknown
    shift is taken as 0.
    """
    array = planar_depth(source, path, image)
    camera = source.cameras.get(image.file_name, source.cameras.get(""))
    intrinsics = camera.intrinsics_px if camera else array.intrinsics_px
    if intrinsics is None:
        raise DepthFileError(
            f"{path.name} has no intrinsics, without which a depth has no normals",
            found="no intrinsics_px",
            expected="fx, fy, cx, cy at the array's size",
            next_step="give --intrinsics",
        )
    return NormalsArray(
        values=fitted_normals(_inverse_depth(array), intrinsics), sign=TOWARDS, stored=array.stored
    )


def _inverse_depth(array: DepthArray) -> F64:
    """(H, W) inverse depths, NaN where there is none in front of the camera."""
    values = array.values.astype(np.float64)
    with np.errstate(all="ignore"):
        inverse: F64 = values if array.space == "disparity" else 1.0 / values
    inverse[~(array.prediction_mask(array.values) & (inverse > 0))] = np.nan
    return inverse


def fitted_normals(inverse: F64, intrinsics_px: Intrinsics) -> NDArray[np.float32]:
    """(H, W, 3) unit normals towards the camera, NaN where no plane can be fitted.

    inverse: (H, W) 1 / z, NaN for none. A plane's inverse depth is affine in the picture,
    1 / z = a x + b y + c with x, y the ray at z = 1, and its normal is -(a, b, c): the line is
    fitted by least squares to the pixels of a 5 x 5 window that lie on the same surface.
    """
    normals = np.empty((*inverse.shape, 3), np.float32)
    padded = np.pad(inverse, _RADIUS, constant_values=np.nan)
    for start in range(0, len(inverse), _BAND_ROWS):
        rows = min(_BAND_ROWS, len(inverse) - start)
        part = padded[start : start + rows + 2 * _RADIUS]
        normals[start : start + rows] = _fitted_band(part, start, intrinsics_px)
    return normals


def _fitted_band(padded: F64, first_row: int, intrinsics_px: Intrinsics) -> F64:
    height, width = padded.shape[0] - 2 * _RADIUS, padded.shape[1] - 2 * _RADIUS
    centre = padded[_RADIUS : _RADIUS + height, _RADIUS : _RADIUS + width]
    sums = np.zeros((9, height, width))

    def offset_at(dy: int, dx: int) -> F64:
        top, left = _RADIUS + dy, _RADIUS + dx
        moved: F64 = padded[top : top + height, left : left + width] - centre
        return moved

    for dy, dx in product(range(-_RADIUS, _RADIUS + 1), repeat=2):
        offset, opposite = offset_at(dy, dx), offset_at(-dy, -dx)
        with np.errstate(invalid="ignore"):
            same: Mask = np.abs(offset) <= _SAME_SURFACE * centre
            same |= np.abs(offset + opposite) <= 2 * _STRAIGHT * centre
        d = np.where(same, offset, 0.0)
        terms: tuple[Any, ...] = (1, dx, dy, dx * dx, dx * dy, dy * dy, d, dx * d, dy * d)
        for total, term in zip(sums, terms, strict=True):
            total += same * term
    n, x, y, xx, xy, yy, d, xd, yd = sums
    with np.errstate(all="ignore"):
        xx, xy, yy, xd, yd = (
            product_ - one * other / n
            for product_, one, other in ((xx, x, x), (xy, x, y), (yy, y, y), (xd, x, d), (yd, y, d))
        )
        determinant = xx * yy - xy * xy
        across, down = (xd * yy - yd * xy) / determinant, (yd * xx - xd * xy) / determinant
        at_centre = centre + (d - across * x - down * y) / n
        fx, fy, cx, cy = intrinsics_px
        a, b = across * fx, down * fy
        c = at_centre - a * ((np.arange(width) + 0.5 - cx) / fx)
        c -= b * ((np.arange(height) + first_row + 0.5 - cy) / fy)[:, None]
        normals: F64 = -np.stack([a, b, c], axis=-1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[~((n >= _FEWEST) & (determinant > 0) & (at_centre > 0))] = np.nan
    return normals
