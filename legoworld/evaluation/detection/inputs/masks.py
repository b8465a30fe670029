"""RLE masks: pycocotools' own functions, and the validity checks that it lacks.

Compressed counts are texts; many are kept in one block of memory.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from io import BytesIO
from itertools import accumulate
from typing import Any, Final, TypedDict, cast, overload

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as _mask

from legoworld.evaluation.kernels.library import call
from legoworld.files import Json

#: Number of positions looked up together.
_BLOCK: Final = 1 << 16
#: JSON may hold halves of surrogate pairs; that no mask does is checked later.
_ENCODING: Final = ("utf-8", "surrogatepass")
#: pycocotools' area() casts the number of masks to uint8, which numpy 2 refuses from 256 on.
_MOST_AREAS: Final = 255
#: Number of texts that are copied in memory while they are measured.
_MOST_MEASURED: Final = 8000


class Texts(Sequence[str]):
    """Texts that are created on access.

    The texts of a results list are allocated between its numbers and dicts: kept individually, they
    would keep the memory around them from being freed.
    """

    def __init__(self, data: bytes, start: NDArray[np.int64]) -> None:
        """data: UTF-8; start: (n + 1,) the start of each text, and the end."""
        self._data = data
        self._start = start

    def take(self, places: NDArray[np.int64]) -> Texts:
        """The texts at these (n,) positions, in their order."""
        taken = TextBuilder()
        for some in np.array_split(places, len(places) // _BLOCK + 1):
            ends = zip(self._start[some].tolist(), self._start[some + 1].tolist(), strict=True)
            taken.add_encoded([self._data[a:b] for a, b in ends])
        return taken.texts()

    def piece(self, first: int, end: int) -> tuple[bytes, NDArray[np.int64]]:
        """The UTF-8 of n texts from one place to another, and where each starts in it, (n + 1,)."""
        start = self._start[first : end + 1]
        return self._data[start[0] : start[-1]], start - start[0]

    def __len__(self) -> int:
        return len(self._start) - 1

    def __iter__(self) -> Iterator[str]:
        return map(self.__getitem__, range(len(self)))

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        """The text at a position, or those of a slice."""
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        return self._data[self._start[index] : self._start[index + 1]].decode(*_ENCODING)


class TextBuilder:
    """Texts put together some at a time: no list of millions is made beside the one piece."""

    def __init__(self) -> None:
        self._data, self._start = BytesIO(), array("q", [0])

    def add(self, texts: Iterable[str]) -> None:
        """Put texts behind those that are there."""
        self.add_encoded([text.encode(*_ENCODING) for text in texts])

    def add_encoded(self, texts: Sequence[bytes]) -> None:
        """The same of their UTF-8."""
        at = self._data.tell()
        self._data.write(b"".join(texts))
        self._start.extend([at + end for end in accumulate(map(len, texts))])

    def texts(self) -> Texts:
        """All of them."""
        return Texts(self._data.getvalue(), np.array(self._start, np.int64))


def pack_texts(texts: Iterable[str]) -> Texts:
    """The same texts."""
    built = TextBuilder()
    built.add(texts)
    return built.texts()


_API: Any = _mask  # its stubs know neither lists of RLE nor text counts


class EncodedMask(TypedDict):
    """A mask as pycocotools takes and gives it. size: [height, width]."""

    size: Sequence[int]
    counts: bytes


def areas_px(masks: Sequence[EncodedMask]) -> NDArray[np.float64]:
    """(n,) pixels of compressed masks."""
    parts = [_API.area(list(masks[i : i + _MOST_AREAS])) for i in range(0, len(masks), _MOST_AREAS)]
    areas: NDArray[np.float64] = np.concatenate([*parts, np.empty(0)]).astype(np.float64)
    return areas


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
        call("lw_measure_masks", text, start, end - first, covered[first:], area[first:])
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
