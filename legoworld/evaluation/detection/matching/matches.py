"""Matching and pairing of all images, chunk by chunk, by the workers of a pool.

A chunk has exactly the data that matching its images needs; matching.cpp matches and pairs it.
`evaluate` holds the numbers that follow from these matches to the evaluator's own on every run.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Final, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.grid import Grid
from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.matching.matched_metrics import Pairs
from legoworld.evaluation.detection.payloads.payload import Overlaps, Payload
from legoworld.evaluation.detection.problem import Detections, Ints, Problem, TrueInstances
from legoworld.evaluation.kernels.library import call, pointer, pointers
from legoworld.workers.tasks import IN_PROCESS, WorkerPool, map_items

#: Detections of a chunk, about: 25 ms of work on boxes, 80 on masks, and at most 3 MB to send.
_CHUNK_DETECTIONS: Final = 8000
#: As many chunks are done by the time that other processes have started and were worth it.
_FEW: Final = 64

Columns = TypeVar("Columns", Detections, TrueInstances)
#: As both evaluators compare: no overlap of 1 is lost to rounding.
_HIGHEST: Final = 1 - 1e-10


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """Consecutive images of a problem.

    detections, truths: the problem's columns of these images, which are counted from the first;
    `entry` and `annotation` still point into the whole run's. first_detection, first_truth:
    (images + 1,) where each image's begin, and their number. sizes_hw: of each image. shapes,
    true_shapes: as the payload packs them: (n, 4) boxes; or compressed counts of masks, and
    polygons or RLE as in the truth.
    """

    payload: Payload
    detections: Detections
    truths: TrueInstances
    first_detection: Ints
    first_truth: Ints
    sizes_hw: tuple[tuple[int, int], ...]
    shapes: Any
    true_shapes: Any


class Chunks(Sequence[Chunk]):
    """All images of a problem in ascending order; chunks are created on access."""

    def __init__(self, problem: Problem, truth: Truth, predictions: Predictions) -> None:
        self._problem = problem
        self._truth = truth
        self._predictions = predictions
        n = len(problem.image_ids)
        self._first_detection = np.searchsorted(problem.detections.image, np.arange(n + 1))
        self._first_truth = np.searchsorted(problem.truths.image, np.arange(n + 1))
        self._edges = _edges(self._first_detection)

    @property
    def many(self) -> bool:
        """Whether starting other processes is worthwhile."""
        return len(self) > _FEW

    @property
    def starts(self) -> tuple[Ints, Ints]:
        """(n_chunks,) places of each chunk's first detection and truth in the problem's columns."""
        first = self._edges[:-1]
        return self._first_detection[first], self._first_truth[first]

    def __len__(self) -> int:
        return len(self._edges) - 1

    @overload
    def __getitem__(self, index: int) -> Chunk: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Chunk]: ...
    def __getitem__(self, index: int | slice) -> Any:
        """The chunk of that number."""
        assert isinstance(index, int)
        first, end = (int(e) for e in self._edges[index : index + 2])
        mine = slice(self._first_detection[first], self._first_detection[end])
        true = slice(self._first_truth[first], self._first_truth[end])
        detections = _slice_columns(self._problem.detections, mine, first)
        truths = _slice_columns(self._problem.truths, true, first)
        payload, shape = self._problem.protocol.payload, self._predictions.entries.shape
        annotations = [self._truth.annotations[k] for k in truths.annotation]
        return Chunk(
            payload=payload,
            detections=detections,
            truths=truths,
            first_detection=self._first_detection[first : end + 1] - mine.start,
            first_truth=self._first_truth[first : end + 1] - true.start,
            sizes_hw=tuple((i["height"], i["width"]) for i in self._truth.images[first:end]),
            shapes=payload.pack_shapes([shape[k] for k in detections.entry.tolist()]),
            true_shapes=payload.pack_shapes([a[payload.field] for a in annotations]),
        )


def _edges(first_detection: Ints) -> Ints:
    """First images of the chunks, and the number of images: cut where another chunk is full."""
    n_images = len(first_detection) - 1
    full = first_detection[:-1] // _CHUNK_DETECTIONS
    starts = np.flatnonzero(np.diff(full, prepend=-1))
    return np.append(starts, n_images)


def _slice_columns(columns: Columns, some: slice, first_image: int) -> Columns:
    cut = {f.name: getattr(columns, f.name)[some] for f in fields(columns)}
    return replace(columns, **{**cut, "image": cut["image"] - first_image})


Column = NDArray[Any]
Arrays = list[Column]


class _ChunkStruct(ctypes.Structure):
    """LwChunk of matching.cpp."""

    _fields_: ClassVar = [
        *pointers("first_detection", "first_truth"),
        ("images", ctypes.c_int64),
        *pointers(
            "iou",
            "category",
            "area",
            "verified",
            "exhaustive",
            "true_category",
            "true_area",
            "ignored",
            "crowd",
        ),
    ]


class _RulesStruct(ctypes.Structure):
    """LwRules of matching.cpp."""

    _fields_: ClassVar = [
        *pointers("thresholds"),
        ("n_thresholds", ctypes.c_int32),
        *pointers("low", "high"),
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
    call("lw_match", struct, rules, state)
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
    aware = ctypes.c_int32(class_aware)
    call("lw_pair", struct, aware, detection, truth, iou, ctypes.byref(n), counted)
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


@dataclass(frozen=True, kw_only=True)
class Matches:
    """The outcome of the detections of a chunk or a whole problem.

    state: (A, T, D) as in MatchTable, in the columns' order; aware, agnostic: the score-free pairs
    within and across categories.
    """

    state: NDArray[np.uint8]
    aware: Pairs
    agnostic: Pairs


def match_chunk(chunk: Chunk) -> Matches:
    """Match and pair the images of a chunk."""
    overlaps = chunk.payload.overlaps(chunk)
    return Matches(
        state=match_chunk_states(chunk, overlaps),
        aware=pair_chunk(chunk, overlaps, class_aware=True),
        agnostic=pair_chunk(chunk, overlaps, class_aware=False),
    )


def match_chunk_by_score(chunk: Chunk) -> NDArray[np.uint8]:
    """The (A, T, D) state alone, which another ranking of the same predictions changes."""
    return match_chunk_states(chunk, chunk.payload.overlaps(chunk))


def match_and_pair(
    problem: Problem, truth: Truth, predictions: Predictions, pool: WorkerPool = IN_PROCESS
) -> Matches:
    """Match and pair every image of a problem, independent of pool and chunks."""
    chunks = Chunks(problem, truth, predictions)
    done = list(map_items(match_chunk, chunks, pool.for_work(worth_a_process=chunks.many)))
    return Matches(
        state=np.concatenate([m.state for m in done], axis=2),
        aware=_join_pairs([m.aware for m in done], chunks),
        agnostic=_join_pairs([m.agnostic for m in done], chunks),
    )


def match_states(
    problem: Problem, truth: Truth, predictions: Predictions, pool: WorkerPool = IN_PROCESS
) -> NDArray[np.uint8]:
    """The (A, T, D) state of every image of a problem, without the score-free pairs."""
    chunks = Chunks(problem, truth, predictions)
    pool = pool.for_work(worth_a_process=chunks.many)
    return np.concatenate(list(map_items(match_chunk_by_score, chunks, pool)), axis=2)


def _join_pairs(parts: list[Pairs], chunks: Chunks) -> Pairs:
    """The chunks' pairs, in positions of the whole problem's columns."""
    detections, truths = chunks.starts
    return Pairs(
        detection=np.concatenate(
            [p.detection + first for p, first in zip(parts, detections, strict=True)]
        ),
        truth=np.concatenate([p.truth + first for p, first in zip(parts, truths, strict=True)]),
        iou=np.concatenate([p.iou for p in parts]),
        counted=np.concatenate([p.counted for p in parts]),
    )
