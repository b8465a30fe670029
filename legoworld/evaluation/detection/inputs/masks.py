"""RLE masks: pycocotools' own functions, and the validity checks that it lacks."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Final, TypedDict, cast

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as _mask

from legoworld.evaluation.detection.inputs.texts import Texts, pack_texts
from legoworld.evaluation.kernels.library import check, library, pointer
from legoworld.files import Json

_API: Any = _mask  # its stubs know neither lists of RLE nor text counts

#: pycocotools' area() casts the number of masks to uint8, which numpy 2 refuses from 256 on.
_MOST_AREAS: Final = 255

#: Number of texts that are copied in memory while they are measured.
_MOST_MEASURED: Final = 8000


class EncodedMask(TypedDict):
    """A mask as pycocotools takes and gives it. size: [height, width]."""

    size: Sequence[int]
    counts: bytes


#: (n, 4) boxes x, y, w, h, or n compressed masks.
Shapes = NDArray[np.float64] | list[EncodedMask]


def areas_px(masks: Sequence[EncodedMask]) -> NDArray[np.float64]:
    """(n,) pixels of compressed masks."""
    parts = [_API.area(list(masks[i : i + _MOST_AREAS])) for i in range(0, len(masks), _MOST_AREAS)]
    areas: NDArray[np.float64] = np.concatenate([*parts, np.empty(0)]).astype(np.float64)
    return areas


def overlaps(detections: Shapes, truths: Shapes, crowd: Sequence[int]) -> NDArray[np.float64]:
    """(detections, truths) IoU, at least one of each; of crowds, the detection's share."""
    return np.asarray(_API.iou(detections, truths, list(crowd)), np.float64)


def union(masks: Sequence[EncodedMask]) -> EncodedMask:
    """The union of compressed masks of one size."""
    merged: EncodedMask = _API.merge(list(masks))
    return merged


def to_pixels(mask: EncodedMask) -> NDArray[np.uint8]:
    """(H, W) 1 inside a compressed mask, row by row in memory."""
    return np.ascontiguousarray(_API.decode(mask))


def from_pixels(pixels: NDArray[Any]) -> EncodedMask:
    """The compressed mask of (H, W) pixels of 0 and 1, or of bool."""
    encoded: EncodedMask = _API.encode(np.asfortranarray(pixels, np.uint8))
    return encoded


def compress_mask(mask: Any, size_hw: tuple[int, int]) -> EncodedMask:
    """Polygons or any RLE as compressed RLE with bytes, the way annToRLE makes it."""
    made: EncodedMask
    if isinstance(mask, list):
        made = _API.merge(_API.frPyObjects(mask, *size_hw))
    elif isinstance(mask["counts"], list):
        made = _API.frPyObjects(mask, *size_hw)
    else:
        made = {"size": mask["size"], "counts": mask["counts"].encode("ascii")}
    return made


def rle_problem(mask: Json, size_wh: tuple[int, int]) -> str | None:
    """The fault of a results mask for an image of this size; None if there is none.

    Of compressed counts only the form is checked: `measure_masks` decodes many at once.
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
    lengths = cast("list[int]", counts)
    pixels = sum(lengths) if min(lengths, default=-1) >= 0 else -1
    return None if pixels == width * height else covers(pixels, size_wh)


def covers(pixels: int, size_wh: tuple[int, int]) -> str:
    """A message that run lengths cover this number of pixels (-1: invalid), not the image's."""
    found = "no run lengths" if pixels < 0 else f"run lengths that add up to {pixels}"
    return f"{found}, {size_wh[0] * size_wh[1]} pixels expected"


def joined_texts(texts: Sequence[bytes]) -> tuple[bytes, NDArray[np.int64]]:
    """Concatenated texts, and the start of each: (n + 1,)."""
    start = np.zeros(len(texts) + 1, np.int64)
    np.cumsum([len(text) for text in texts], out=start[1:])
    return b"".join(texts), start


def measure_masks(counts: Sequence[str]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(n,) sums of the run lengths in pycocotools' compressed counts, and (n,) pixels of the mask.

    The sum is -1 for a truncated or malformed text, or one with a negative run; of such a one
    the pixels say nothing. rleToString in pycocotools' maskApi.c is what defines the format.
    """
    texts = counts if isinstance(counts, Texts) else pack_texts(counts)
    covered, area = np.empty(len(texts), np.int64), np.empty(len(texts))
    for first in range(0, len(texts), _MOST_MEASURED):
        end = min(first + _MOST_MEASURED, len(texts))
        text, start = texts.piece(first, end)
        done = library().lw_measure_masks(
            ctypes.c_char_p(text), pointer(start), ctypes.c_int64(end - first),
            pointer(covered[first:]), pointer(area[first:]),
        )  # fmt: skip
        check(done)
    return covered, area


def intersection_px(one: EncodedMask, other: EncodedMask) -> int:
    """Pixels that two compressed masks of one size share."""
    return int(_API.area(_API.merge([one, other], intersect=True)))


def difference(one: EncodedMask, other: EncodedMask) -> EncodedMask:
    """What of a compressed mask lies outside of another."""
    return from_pixels(to_pixels(one) > to_pixels(other))


def bounding_box(mask: EncodedMask) -> tuple[float, float, float, float]:
    """x, y, w, h of a compressed mask's pixels, with pixel edges."""
    x, y, width, height = _API.toBbox(mask).tolist()
    return x, y, width, height
