"""Masks and polygons of strangers, checked before pycocotools sees them.

pycocotools trusts its input: it measures run lengths that do not add up to the picture on memory
that holds anything, and far-off corners of a polygon take gigabytes or end the process. (Scoring
measures the masks of whole files in C++: evaluation/detection/inputs/masks.)
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

#: pycocotools walks a polygon's edges pixel by pixel in 32-bit integers: far-off corners cost
#: gigabytes, and end the process from 4e8 on.
MOST_COORDINATE_PX: Final = 1e6


def are_near(coordinates: Iterable[float]) -> bool:
    """Whether coordinates of a polygon, pixels, can be filled at all."""
    return all(-MOST_COORDINATE_PX < value < MOST_COORDINATE_PX for value in coordinates)


def covered_px(counts: str) -> int:
    """The sum of the run lengths in pycocotools' compressed counts; -1 where they are none.

    rleFrString in pycocotools' maskApi.c is what defines the format.
    """
    runs: list[int] = []
    value = shift = 0
    for character in counts:
        bits = ord(character) - 48
        if not 0 <= bits < 64 or shift > 30:
            return -1
        value |= (bits & 0x1F) << shift
        shift += 5
        if bits & 0x20:
            continue
        if bits & 0x10:
            value -= 1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = shift = 0
    return -1 if shift or min(runs, default=-1) < 0 else sum(runs)
