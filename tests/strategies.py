"""What hypothesis draws for the laws of several folders; the profile is in conftest.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from evaluation.made_chunks import chunk_of
from hypothesis import example
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from legoworld.evaluation.detection.grid import N_THRESHOLDS
from legoworld.evaluation.detection.matching.matches import Chunk
from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    IGNORED,
    TRUE_POSITIVE,
)
from legoworld.evaluation.detection.payloads.payload import Overlaps

Array = NDArray[Any]
Test = TypeVar("Test", bound=Callable[..., None])

#: Overlaps on, beside and between the thresholds; few values, so that many are equal.
_OVERLAPS = (0.0, 0.5, 0.95, 0.3, 0.75, 0.7500001, 0.8, 1.0)
#: Areas on and beside the limits of COCO's small, medium and large.
_AREAS = (0.0, 500.0, 1024.0, 2000.0, 9216.0, 1e5)


@st.composite
def id_pictures(draw: st.DrawFn) -> Array:
    """(H, W) int32 instance ids, -1 for none: single pixels, or areas of 3 x 5."""
    n = draw(st.integers(0, 8))
    shape = st.tuples(st.integers(1, 12), st.integers(1, 12))
    ids = draw(arrays.arrays(np.int32, shape, elements=st.integers(-1, n)))
    if draw(st.booleans()):
        ids = np.repeat(np.repeat(ids, 5, axis=0), 3, axis=1)
        ids = ids[: draw(st.integers(1, 60)), : draw(st.integers(1, 36))]
    return np.ascontiguousarray(ids)


@st.composite
def blobs(draw: st.DrawFn, size_hw: tuple[int, int]) -> Array:
    """Pixels of a few rectangles, or none, or all; with runs from end to end of the picture."""
    pixels = np.zeros(size_hw, np.uint8, order="F")
    height, width = size_hw
    places = st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))
    sizes = st.tuples(st.integers(1, 19), st.integers(1, 19))
    for (top, left), (high, wide) in draw(st.lists(st.tuples(places, sizes), max_size=3)):
        pixels[top : top + high, left : left + wide] = 1
    return 1 - pixels if draw(st.integers(0, 9)) == 9 else pixels


@st.composite
def chunks(draw: st.DrawFn) -> tuple[Chunk, Overlaps]:
    """Images with detections and truths of few categories, and overlaps full of ties.

    In half of them all truths count and all categories are checked.
    """
    n_images, odd = draw(st.integers(1, 6)), draw(st.booleans())
    categories = st.integers(0, 2)

    def per_image(most: int) -> st.SearchStrategy[list[list[int]]]:
        one = st.lists(categories, max_size=most)
        return st.lists(one, min_size=n_images, max_size=n_images)

    found, wanted = [sorted(one) for one in draw(per_image(13))], draw(per_image(6))
    n, g = sum(map(len, found)), sum(map(len, wanted))

    def flags(count: int) -> Array:
        return draw(arrays.arrays(bool, count)) if odd else np.zeros(count, bool)

    def values(count: int, of: tuple[float, ...]) -> Array:
        drawn = st.sampled_from(of)
        return draw(arrays.arrays(np.float64, count, elements=drawn, fill=st.nothing()))

    ignored = flags(g)
    chunk = chunk_of(
        found,
        wanted,
        unverified=flags(n),
        not_exhaustive=flags(n),
        ignored=ignored,
        crowd=ignored & flags(g),
        area=values(g, _AREAS),
    )
    n_pairs = sum(len(f) * len(w) for f, w in zip(found, wanted, strict=True))
    few = _OVERLAPS[: draw(st.sampled_from([3, 8]))]
    return chunk, Overlaps(iou=values(n_pairs, few), area=values(n, (0.0, 1024.0, 1e4)))


@st.composite
def rankings(draw: st.DrawFn, most: int) -> tuple[Array, list[float], int]:
    """(T, D) states of a category's detections, scores in tied runs, and how many truths it has.

    A match holds up to some threshold and is false above it; some are ignored.
    """
    n_thresholds = N_THRESHOLDS
    kinds = st.sampled_from([FALSE_POSITIVE, TRUE_POSITIVE, TRUE_POSITIVE, IGNORED])
    matches = draw(
        st.lists(st.tuples(kinds, st.integers(1, n_thresholds)), min_size=1, max_size=most)
    )
    states = np.full((n_thresholds, len(matches)), FALSE_POSITIVE, np.uint8)
    for d, (kind, upto) in enumerate(matches):
        states[:upto, d] = kind
    falls = draw(
        st.lists(st.sampled_from([0, 0, 0, 1]), min_size=len(matches), max_size=len(matches))
    )
    scores = [1 / (1 + int(level)) for level in np.cumsum(falls)]
    n_true = int((states == TRUE_POSITIVE).any(axis=0).sum())
    return states, scores, max(1, n_true + draw(st.integers(0, 3)))


@dataclass(frozen=True)
class Damage:
    """What a disk or a hand does to a file's content, whatever its length; see `FIXED`."""

    kind: str
    at: int = 0
    bit: int = 0

    def of(self, data: bytes) -> bytes:
        """The damaged content."""
        if self.kind in FIXED:
            return FIXED[self.kind](data)
        at = self.at % len(data)
        if self.kind == "cut off":
            return data[:at]
        changed = {"flipped": data[at] ^ 1 << self.bit, "a line's end": ord("\n"), "0xff": 0xFF}
        return data[:at] + bytes([changed[self.kind]]) + data[at + 1 :]


FIXED: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _data: b"",
    "nested deep": lambda _data: b"[" * 100_000,
    "an object": lambda _data: b"{}",
    "a list": lambda _data: b"[]",
    "null": lambda _data: b"null",
    "no text": lambda data: b"\xff" + data,
    "doubled": lambda data: data + data,
    "without its first byte": lambda data: data[1:],
}


def damages() -> st.SearchStrategy[Damage]:
    """Damage at a place: cut off, flipped or replaced."""
    kinds = st.sampled_from(["cut off", "flipped", "a line's end", "0xff"])
    return st.builds(Damage, kind=kinds, at=st.integers(0, 1 << 20), bit=st.integers(0, 7))


def with_fixed_damage(test: Test) -> Test:
    """Besides what is drawn, each content of FIXED, as the argument `damage`."""
    for kind in FIXED:
        test = example(damage=Damage(kind=kind))(test)
    return test
