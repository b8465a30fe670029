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

#: The characters of compressed counts, how many texts are decoded together, and the most
#: characters a number may have: 7 bits over what any image needs.
_CHARACTERS: Final = bytes(range(48, 112))
_MOST_DECODED: Final = 500
_MOST_DIGITS: Final = 7

Rle = dict[str, Any]
#: (n, 4) boxes x, y, w, h, or n compressed masks.
Shapes = NDArray[np.float64] | list[Rle]

#: pycocotools walks a polygon's edges pixel by pixel in 32-bit integers: far-off corners cost
#: gigabytes, and end the process from 4e8 on.
MOST_COORDINATE_PX: Final = 1e6


def areas_px(masks: Sequence[Rle]) -> NDArray[np.float64]:
    """(n,) pixels of compressed masks."""
    parts = [_API.area(list(masks[i : i + _MOST_AREAS])) for i in range(0, len(masks), _MOST_AREAS)]
    areas: NDArray[np.float64] = np.concatenate([*parts, np.empty(0)]).astype(np.float64)
    return areas


def overlaps(detections: Shapes, truths: Shapes, crowd: Sequence[int]) -> NDArray[np.float64]:
    """(detections, truths) IoU, at least one of each; of crowds, the detection's share."""
    return np.asarray(_API.iou(detections, truths, list(crowd)), np.float64)


def union(masks: Sequence[Rle]) -> Rle:
    """The pixels that any of some compressed masks of one size covers."""
    merged: Rle = _API.merge(list(masks))
    return merged


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
    """What is wrong with a results mask of an image of this size; None when nothing is.

    Of compressed counts only the form is looked at: `pixels_covered` decodes them, many at once.
    """
    if isinstance(mask, list):
        return "a polygon list"
    if not isinstance(mask, dict) or not {"size", "counts"} <= mask.keys():
        return repr(mask)[:60]
    width, height = size_wh
    if mask["size"] != [height, width]:
        return f"size {mask['size']}, the image's [height, width] is {[height, width]}"
    counts = mask["counts"]
    if isinstance(counts, str):
        return None
    if not isinstance(counts, list) or not all(type(c) is int for c in counts):
        return f"counts of type {type(counts).__name__}"
    pixels = sum(counts) if min(counts, default=-1) >= 0 else -1
    return None if pixels == width * height else covers(pixels, size_wh)


def covers(pixels: int, size_wh: tuple[int, int]) -> str:
    """In words, that run lengths cover so many pixels (-1: are none) and not the image's."""
    found = "no run lengths" if pixels < 0 else f"run lengths that add up to {pixels}"
    return f"{found}, {size_wh[0] * size_wh[1]} pixels expected"


def pixels_covered(counts: Sequence[str]) -> NDArray[np.int64]:
    """(n,) sums of the run lengths in pycocotools' compressed counts.

    -1 for a text that is cut or foreign, or that holds a negative run. Five bits a character with
    a continuation bit, sign-extended; from the fourth number on, each is the difference to the
    last but one (rleToString in pycocotools' maskApi.c).
    """
    parts = [
        _pixels_covered([c.encode("utf-8", "surrogatepass") for c in counts[i : i + _MOST_DECODED]])
        for i in range(0, len(counts), _MOST_DECODED)
    ]
    return np.concatenate([*parts, np.empty(0, np.int64)])


def _pixels_covered(texts: list[bytes]) -> NDArray[np.int64]:
    pixels = np.full(len(texts), -1, np.int64)
    numeric = np.array([bool(t) and not t.translate(None, _CHARACTERS) for t in texts], bool)
    ended = np.array([bool(t) and not (t[-1] - 48) & 32 for t in texts], bool)
    usable = np.flatnonzero(numeric & ended)
    if not len(usable):
        return pixels
    codes = np.frombuffer(b"".join(texts[i] for i in usable), np.uint8).astype(np.int64) - 48
    edges = np.cumsum([len(texts[i]) for i in usable])
    last = np.flatnonzero((codes & 32) == 0)
    first = np.concatenate([[0], last[:-1] + 1])
    n_numbers = np.searchsorted(last, edges - 1) + 1  # up to each text's end
    text_of = np.repeat(np.arange(len(usable)), np.diff(n_numbers, prepend=0))
    place = np.arange(len(last)) - np.repeat(
        np.concatenate([[0], n_numbers[:-1]]), np.diff(n_numbers, prepend=0)
    )
    n_digits = last - first + 1
    digit = np.arange(len(codes)) - np.repeat(first, n_digits)
    values = np.add.reduceat((codes & 31) << np.minimum(5 * digit, 50), first)
    negative = (codes[last] & 16) != 0
    values[negative] -= np.int64(1) << np.minimum(5 * n_digits[negative], 55)
    # x[m] = value[m] + x[m - 2] from m = 3 on: two interleaved running sums. x[0] takes no part.
    for chain in (place % 2 == 1, (place % 2 == 0) & (place > 0)):
        values[chain] = _running_sums(values[chain], text_of[chain])
    unsound = np.zeros(len(usable), bool)
    unsound[text_of[(values < 0) | (n_digits > _MOST_DIGITS)]] = True
    sums = np.add.reduceat(values, np.concatenate([[0], n_numbers[:-1]]))
    pixels[usable] = np.where(unsound, -1, sums)
    return pixels


def _running_sums(values: NDArray[np.int64], text_of: NDArray[np.intp]) -> NDArray[np.int64]:
    """Cumulative sums that start anew in every text. text_of: (n,) ascending."""
    sums = np.cumsum(values)
    starts = np.flatnonzero(np.diff(text_of, prepend=-1))
    before = np.concatenate([[0], sums])[starts]
    return np.asarray(sums - np.repeat(before, np.diff(starts, append=len(values))))


def bounding_box(mask: Rle) -> list[float]:
    """x, y, w, h of a compressed mask's pixels, with pixel edges."""
    box: list[float] = _API.toBbox(mask).tolist()
    return box
