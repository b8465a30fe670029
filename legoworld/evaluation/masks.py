"""RLE masks: pycocotools' own functions, and whether a text is a mask, which it never asks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as _mask

_API: Any = _mask  # its stubs know neither lists of RLE nor text counts

#: pycocotools' area() casts the number of masks to uint8, which numpy 2 refuses from 256 on.
_MOST_AREAS: Final = 255

Rle = dict[str, Any]


def areas_px(masks: Sequence[Rle]) -> NDArray[np.float64]:
    """(n,) pixels of compressed masks."""
    parts = [_API.area(list(masks[i : i + _MOST_AREAS])) for i in range(0, len(masks), _MOST_AREAS)]
    areas: NDArray[np.float64] = np.concatenate([*parts, np.empty(0)]).astype(np.float64)
    return areas


def overlaps(
    detections: Sequence[Any], truths: Sequence[Any], crowd: Sequence[int]
) -> NDArray[np.float64]:
    """(detections, truths) IoU of boxes or compressed masks; of crowds, the detection's share."""
    return np.asarray(_API.iou(list(detections), list(truths), list(crowd)), np.float64)


def compressed(mask: Any, size_hw: tuple[int, int]) -> Rle:
    """Polygons or any RLE as compressed RLE with bytes, the way annToRLE makes it."""
    made: Rle
    if isinstance(mask, list):
        made = _API.merge(_API.frPyObjects(mask, *size_hw))
    elif isinstance(mask["counts"], list):
        made = _API.frPyObjects(mask, *size_hw)
    else:
        made = {"size": mask["size"], "counts": mask["counts"].encode("ascii")}
    return made


def rle_problem(mask: Any, size_wh: tuple[int, int]) -> str | None:
    """What is wrong with a results mask of an image of this size; None when nothing is."""
    if isinstance(mask, list):
        return "a polygon list"
    if not isinstance(mask, dict) or not {"size", "counts"} <= mask.keys():
        return repr(mask)[:60]
    width, height = size_wh
    if mask["size"] != [height, width]:
        return f"size {mask['size']}, the image's [height, width] is {[height, width]}"
    counts = mask["counts"]
    if isinstance(counts, str):
        runs = run_lengths(counts)
    elif isinstance(counts, list) and all(type(c) is int for c in counts):
        runs = np.array(counts, np.int64)
    else:
        return f"counts of type {type(counts).__name__}"
    if runs is None or (runs < 0).any() or int(runs.sum()) != width * height:
        total = "no run lengths" if runs is None else f"run lengths that add up to {runs.sum()}"
        return f"{total}, {width * height} pixels expected"
    return None


def run_lengths(counts: str) -> NDArray[np.int64] | None:
    """The run lengths in pycocotools' compressed counts; None when the text is cut or foreign.

    Five bits a character with a continuation bit, sign-extended; from the fourth number on, each
    is the difference to the last but one (rleToString in pycocotools' maskApi.c).
    """
    codes = np.frombuffer(counts.encode("utf-8"), np.uint8).astype(np.int64) - 48
    if not len(codes) or codes.min() < 0 or codes.max() > 63 or codes[-1] & 32:
        return None
    last = np.flatnonzero((codes & 32) == 0)
    first = np.concatenate([[0], last[:-1] + 1])
    digit = np.arange(len(codes)) - np.repeat(first, last - first + 1)
    if digit.max() > 10:
        return None
    values = np.add.reduceat((codes & 31) << (5 * digit), first)
    negative = (codes[last] & 16) != 0
    values[negative] -= np.int64(1) << (5 * (digit[last][negative] + 1))
    # x[m] = value[m] + x[m - 2] from m = 3 on: two interleaved running sums. x[0] takes no part.
    values[1::2] = np.cumsum(values[1::2])
    values[2::2] = np.cumsum(values[2::2])
    return values
