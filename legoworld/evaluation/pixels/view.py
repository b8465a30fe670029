"""A small view of ground truth and prediction for the report, made of real pixels."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.pixels.family import Index, Mask

LONGEST_SIDE: Final = 256


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
