"""A small view of ground truth and aligned prediction for the report, made of real pixels."""

from __future__ import annotations

import base64
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.depth.alignment import aligned_z
from legoworld.evaluation.depth.resampling import Sample
from legoworld.evaluation.depth.scoring import valid_truth
from legoworld.records.evaluation_view import DepthView, Fit

LONGEST_SIDE: Final = 256


def small_view(truth_z_m: NDArray[Any], sample: Sample, fit: Fit, deepest_z_m: float) -> DepthView:
    """One image's view.

    The image is divided into at most 256 blocks per side. A block shows its first pixel, in row
    order, with valid truth, else its middle pixel; ground truth and prediction are always from the
    same pixel. truth_z_m and aligned_z_m are base64 of little-endian float32, row major, inf where
    there is no value; size_wh is the view's size, image_wh the ground truth's.
    """
    height, width = truth_z_m.shape
    shrink = max(1.0, max(width, height) / LONGEST_SIDE)
    view_w, view_h = max(1, int(width / shrink)), max(1, int(height / shrink))
    rows, cols = _pixels_shown(truth_z_m, (view_w, view_h))
    true_z_m = truth_z_m[rows, cols]
    true_z_m = np.where(valid_truth(true_z_m), true_z_m, np.inf)
    sampled = sample(rows, cols)
    z_m, _ = aligned_z(sampled.disparity, fit, 1.0 / deepest_z_m)
    return DepthView(
        size_wh=(view_w, view_h),
        image_wh=(width, height),
        truth_z_m=_base64(true_z_m),
        aligned_z_m=_base64(np.where(sampled.predicted, z_m, np.inf)),
        fit=fit,
    )


def decoded(text: str, size_wh: tuple[int, int]) -> NDArray[np.float32]:
    """A view's array as (height, width) float32."""
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(size_wh[::-1])


def _pixels_shown(
    truth_z_m: NDArray[Any], view_wh: tuple[int, int]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row and column of each block's pixel, (view_h * view_w,) each."""
    height, width = truth_z_m.shape
    view_w, view_h = view_wh
    top = np.arange(view_h + 1) * height // view_h
    left = np.arange(view_w + 1) * width // view_w
    block_of_col = np.searchsorted(left, np.arange(width), side="right") - 1
    rows = np.repeat((top[:-1] + top[1:]) // 2, view_w).reshape(view_h, view_w)
    cols = np.tile((left[:-1] + left[1:]) // 2, (view_h, 1))
    for i in range(view_h):
        found_rows, found_cols = np.nonzero(valid_truth(truth_z_m[top[i] : top[i + 1]]))
        # Of several values for one block the last is kept: backwards, that is the first pixel.
        blocks = block_of_col[found_cols[::-1]]
        rows[i, blocks] = found_rows[::-1] + top[i]
        cols[i, blocks] = found_cols[::-1]
    return rows.ravel().astype(np.intp), cols.ravel().astype(np.intp)


def _base64(values: NDArray[Any]) -> str:
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")
