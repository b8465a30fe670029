"""A problem divided into chunks of images, each with exactly the data that matching needs.

A chunk is the unit of work of a worker: columns as arrays, and the shapes of its images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, TypeVar, overload

import numpy as np

from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.payloads.payload import Payload
from legoworld.evaluation.detection.problem import Detections, Ints, Problem, TrueInstances

#: Detections of a chunk, about: 25 ms of work on boxes, 80 on masks, and at most 3 MB to send.
_CHUNK_DETECTIONS: Final = 8000
#: As many chunks are done by the time that other processes have started and were worth it.
_FEW: Final = 64

Columns = TypeVar("Columns", Detections, TrueInstances)


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
            shapes=payload.packed([shape[k] for k in detections.entry.tolist()]),
            true_shapes=payload.packed([a[payload.field] for a in annotations]),
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
