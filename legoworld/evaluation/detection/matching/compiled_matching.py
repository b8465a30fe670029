"""Greedy matching and score-free pairing of a chunk: matching.cpp behind ctypes.

`evaluate` holds the numbers that follow from these matches to the evaluator's own on every run.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.grid import Grid
from legoworld.evaluation.detection.matching.chunks import Chunk
from legoworld.evaluation.detection.matching.matched_metrics import Pairs
from legoworld.evaluation.detection.payloads.payload import Overlaps
from legoworld.evaluation.detection.problem import Ints
from legoworld.evaluation.kernels.library import check, library, pointer

#: As both evaluators compare: no overlap of 1 is lost to rounding.
_HIGHEST: Final = 1 - 1e-10

Column = NDArray[Any]
Arrays = list[Column]


class _ChunkStruct(ctypes.Structure):
    """LwChunk of matching.cpp."""

    _fields_: ClassVar = [
        ("first_detection", ctypes.c_void_p),
        ("first_truth", ctypes.c_void_p),
        ("images", ctypes.c_int64),
        ("iou", ctypes.c_void_p),
        ("category", ctypes.c_void_p),
        ("area", ctypes.c_void_p),
        ("verified", ctypes.c_void_p),
        ("exhaustive", ctypes.c_void_p),
        ("true_category", ctypes.c_void_p),
        ("true_area", ctypes.c_void_p),
        ("ignored", ctypes.c_void_p),
        ("crowd", ctypes.c_void_p),
    ]


class _RulesStruct(ctypes.Structure):
    """LwRules of matching.cpp."""

    _fields_: ClassVar = [
        ("thresholds", ctypes.c_void_p),
        ("n_thresholds", ctypes.c_int32),
        ("low", ctypes.c_void_p),
        ("high", ctypes.c_void_p),
        ("n_areas", ctypes.c_int32),
    ]


def match_chunk_states(chunk: Chunk, overlaps: Overlaps) -> NDArray[np.uint8]:
    """(A, T, D) the outcome of a chunk's detections, as in MatchTable."""
    first = chunk.first_detection, chunk.first_truth
    return match_columns(chunk.payload.grid, first, *_columns(chunk, overlaps))


def match_columns(
    grid: Grid, first: tuple[Ints, Ints], detections: Sequence[Column], truths: Sequence[Column]
) -> NDArray[np.uint8]:
    """(A, T, D) the outcome of detections that are given as columns.

    first: (images + 1,) where each image's detections and truths begin. detections: overlaps as in
    Overlaps.iou, then category, area, verified, exhaustive; truths: category, area, ignored, crowd.
    """
    struct, _kept = _struct(first, [*detections, *truths])
    thresholds, (low, high) = np.minimum(grid.iou, _HIGHEST), np.array(grid.ranges).T.copy()
    rules = _RulesStruct(
        pointer(thresholds), len(thresholds), pointer(low), pointer(high), len(low)
    )
    state = np.zeros((len(low), len(thresholds), len(detections[1])), np.uint8)
    check(library().lw_match(ctypes.byref(struct), ctypes.byref(rules), pointer(state)))
    return state


def pair_chunk(chunk: Chunk, overlaps: Overlaps, *, class_aware: bool) -> Pairs:
    """The one-to-one pairs of a chunk that maximise overlap; within categories, or across them.

    Ties (to about nine decimals) are broken by more hits, then by more hits with the correct label.
    Without this rule the numbers would depend on the order of the ids.
    """
    detections, truths = _columns(chunk, overlaps)
    first = chunk.first_detection, chunk.first_truth
    struct, _kept = _struct(first, [*detections, *truths])
    most = len(chunk.truths.image)
    detection, truth, iou = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most)
    counted = np.empty(len(chunk.detections.image), bool)
    n = ctypes.c_int64()
    done = library().lw_pair(
        ctypes.byref(struct), ctypes.c_int32(class_aware), pointer(detection), pointer(truth),
        pointer(iou), ctypes.byref(n), pointer(counted),
    )  # fmt: skip
    check(done)
    some = slice(n.value)
    return Pairs(detection=detection[some], truth=truth[some], iou=iou[some], counted=counted)


def _columns(chunk: Chunk, overlaps: Overlaps) -> tuple[list[Column], list[Column]]:
    """The columns of a chunk as `match_columns` takes them."""
    d, t = chunk.detections, chunk.truths
    detections: list[Column] = [overlaps.iou, d.category, overlaps.area, d.verified, d.exhaustive]
    return detections, [t.category, t.area, t.ignored, t.crowd]


def _struct(first: tuple[Ints, Ints], columns: Sequence[Column]) -> tuple[_ChunkStruct, Arrays]:
    """Columns as the library reads them, and the arrays that this points into."""
    kept = [np.ascontiguousarray(array) for array in (*first, *columns)]
    pointers = [pointer(array) for array in kept]
    return _ChunkStruct(*pointers[:2], len(first[0]) - 1, *pointers[2:]), kept
