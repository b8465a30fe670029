"""A prediction at the ground truth's pixels (direct, scaled or warped), and small views of both."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.headers import SizeCheck
from legoworld.evaluation.pixels.family import F64, Index, Mask, PixelArray, PixelFamily

LONGEST_SIDE: Final = 256


@dataclass(frozen=True, kw_only=True)
class SampledPrediction:
    """A prediction at n ground-truth pixels.

    values: (n,) or (n, channels), 0 where not predicted. predicted, outside: (n,); outside: not
    predicted because the pixel lies outside the prediction's view.
    """

    values: F64
    predicted: NDArray[np.bool_]
    outside: NDArray[np.bool_]


#: Maps ground-truth pixels (rows, cols), each (n,), to the prediction there.
Sample = Callable[[Index, Index], SampledPrediction]
#: Maps positions (n, 2) in the truth's picture to those that the prediction has there, in pixels
#: of the truth's size.
Warp = Callable[[F64], F64]

#: Tolerance of the aspect: sides of network inputs are multiples of about 14.
_ASPECT_TOLERANCE: Final = 0.05
#: Less than half the weight on predicted neighbours: the point is a hole.
_MIN_WEIGHT: Final = 0.5
#: Positions outside the image by this little are rounding errors of its edge.
_EDGE_PX: Final = 1e-6


def sampler(prediction: PixelArray, truth_wh: tuple[int, int], warp: Warp | None = None) -> Sample:
    """A function that reads a prediction at (n,) rows and columns of the ground truth.

    The prediction has the truth's aspect and at most its size, as `size_check` holds it to. warp:
    None reads at the same image position.
    """
    if prediction.size_wh == truth_wh and warp is None:
        return lambda rows, cols: _same_pixels(prediction, rows, cols)
    scale_xy = np.array([p / t for p, t in zip(prediction.size_wh, truth_wh, strict=True)])

    def sample(rows: Index, cols: Index) -> SampledPrediction:
        xy_px = np.stack([cols + 0.5, rows + 0.5], axis=1)
        if warp is not None:
            xy_px = warp(xy_px)
        return bilinear(prediction, xy_px * scale_xy)

    return sample


def bilinear(prediction: PixelArray, xy_px: F64) -> SampledPrediction:
    """Values at positions (n, 2), x and y from the top left corner; pixel centres are at .5.

    Weights are those of bilinear interpolation (edge pixels continue outwards by half a pixel),
    renormalised over the neighbours that hold a prediction. A point is a hole when they carry
    less than half of the weight, or when it lies outside the picture.
    """
    width, height = prediction.size_wh
    x, y = xy_px[:, 0], xy_px[:, 1]
    inside = (x >= -_EDGE_PX) & (x <= width + _EDGE_PX)
    inside &= (y >= -_EDGE_PX) & (y <= height + _EDGE_PX)
    left, right_weight = _neighbours(np.where(inside, x, 0.0))
    top, bottom_weight = _neighbours(np.where(inside, y, 0.0))
    total = np.zeros((len(x), *prediction.values.shape[2:]))
    weights = np.zeros(len(x))
    for row_step, row_weight in ((0, 1.0 - bottom_weight), (1, bottom_weight)):
        rows = np.clip(top + row_step, 0, height - 1)
        for col_step, col_weight in ((0, 1.0 - right_weight), (1, right_weight)):
            cols = np.clip(left + col_step, 0, width - 1)
            values, predicted = prediction.at(rows, cols)
            weight = row_weight * col_weight * predicted
            total += (weight * values.T).T  # of every channel
            weights += weight
    sampled = inside & (weights >= _MIN_WEIGHT)
    means = np.zeros_like(total)
    np.divide(total.T, weights, out=means.T, where=sampled)
    return SampledPrediction(values=means, predicted=sampled, outside=~inside)


def _same_pixels(prediction: PixelArray, rows: Index, cols: Index) -> SampledPrediction:
    values, predicted = prediction.at(rows, cols)
    return SampledPrediction(values=values, predicted=predicted, outside=np.zeros_like(predicted))


def size_check(family: PixelFamily, truth_wh: tuple[int, int]) -> SizeCheck:
    """Raises the family's error for a prediction of another aspect, or larger than the truth."""
    return partial(_check_size, truth_wh, family)


def _check_size(
    truth_wh: tuple[int, int], family: PixelFamily, prediction_wh: tuple[int, int]
) -> None:
    if prediction_wh == truth_wh:
        return
    width, height = prediction_wh
    expected = truth_wh[1] * width / truth_wh[0]
    same_aspect = abs(height - expected) <= max(1.0, _ASPECT_TOLERANCE * expected)
    smaller = width <= truth_wh[0] and height <= truth_wh[1]
    if same_aspect and smaller:
        return
    transposed = prediction_wh == truth_wh[::-1]
    raise family.errors.prediction(
        f"the predicted {family.noun} is of another size",
        found=f"{width}x{height}" + (", rotated by 90 degrees" if transposed else ""),
        expected=f"{truth_wh[0]}x{truth_wh[1]}, or smaller with the same aspect",
        next_step="a photo's EXIF rotation is never applied; resize to the truth's size"
        if transposed
        else "predict at the photo's size",
    )


def _neighbours(position_px: F64) -> tuple[Index, F64]:
    """The index of the pixel centre at or before a position, and the next one's weight."""
    shifted = position_px - 0.5
    first = np.floor(shifted)
    return first.astype(np.intp), shifted - first


@dataclass(frozen=True, kw_only=True)
class ShownPixels:
    """The pixels of a small view. rows, cols: (view_h * view_w,) in the truth."""

    size_wh: tuple[int, int]
    rows: Index
    cols: Index


def shown_pixels(truth: NDArray[Any], valid: Callable[[NDArray[Any]], Mask]) -> ShownPixels:
    """The pixels that stand for an image in at most 256 blocks per side.

    A block shows its first pixel, in row order, with valid truth, else its middle pixel; ground
    truth and prediction are always from the same pixel. truth: (H, W) or (H, W, 3).
    """
    height, width = truth.shape[:2]
    shrink = max(1.0, max(width, height) / LONGEST_SIDE)
    view_w, view_h = max(1, int(width / shrink)), max(1, int(height / shrink))
    top = np.arange(view_h + 1) * height // view_h
    left = np.arange(view_w + 1) * width // view_w
    block_of_col = np.searchsorted(left, np.arange(width), side="right") - 1
    rows = np.repeat((top[:-1] + top[1:]) // 2, view_w).reshape(view_h, view_w)
    cols = np.tile((left[:-1] + left[1:]) // 2, (view_h, 1))
    for i in range(view_h):
        found_rows, found_cols = np.nonzero(valid(truth[top[i] : top[i + 1]]))
        # Of several values for one block the last is kept: backwards, that is the first pixel.
        blocks = block_of_col[found_cols[::-1]]
        rows[i, blocks] = found_rows[::-1] + top[i]
        cols[i, blocks] = found_cols[::-1]
    return ShownPixels(
        size_wh=(view_w, view_h),
        rows=rows.ravel().astype(np.intp),
        cols=cols.ravel().astype(np.intp),
    )


def encode_array(values: NDArray[Any], known: Mask, hole: float) -> str:
    """Values (n,) or (n, channels) as base64 of little-endian float32, `hole` where not known."""
    kept = np.where(known, values.T, hole).T
    return base64.b64encode(np.ascontiguousarray(kept).astype("<f4").tobytes()).decode("ascii")


def decode_array(text: str, size_wh: tuple[int, int], channels: int = 1) -> NDArray[np.float32]:
    """A view's array as (height, width) float32, or (height, width, channels)."""
    shape = (*size_wh[::-1], *((channels,) if channels > 1 else ()))
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(shape)
