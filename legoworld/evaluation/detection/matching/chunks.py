"""A problem divided into chunks of images, each with exactly the data that matching needs.

A chunk is the unit of work of a worker: columns as arrays, and the shapes of its images.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, TypeVar, overload

import numpy as np

from legoworld.evaluation.detection.inputs.predictions import Predictions
from legoworld.evaluation.detection.inputs.texts import Texts
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.problem import Detections, Floats, Ints, Problem, TrueInstances
from legoworld.evaluation.detection.protocols import IouType

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
    (images + 1,) where each image's begin, and their number. sizes_hw: of each image. boxes,
    true_boxes: (n, 4) x, y, w, h; empty where masks are compared. masks: compressed counts;
    true_masks: polygons or RLE as in the truth; both empty where boxes are compared.
    """

    iou_type: IouType
    detections: Detections
    truths: TrueInstances
    first_detection: Ints
    first_truth: Ints
    sizes_hw: tuple[tuple[int, int], ...]
    boxes: Floats
    true_boxes: Floats
    masks: tuple[str, ...]
    true_masks: tuple[Any, ...]


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
        """Positions of each chunk's first detection and first truth in the problem's columns."""
        first = self._edges[:-1]
        return self._first_detection[first], self._first_truth[first]

    def __len__(self) -> int:
        return len(self._edges) - 1

    @overload
    def __getitem__(self, index: int) -> Chunk: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Chunk]: ...
    def __getitem__(self, index: Any) -> Any:
        """The chunk of that number."""
        assert isinstance(index, int)
        first, end = (int(e) for e in self._edges[index : index + 2])
        mine = slice(self._first_detection[first], self._first_detection[end])
        true = slice(self._first_truth[first], self._first_truth[end])
        detections = _cut(self._problem.detections, mine, first)
        truths = _cut(self._problem.truths, true, first)
        shape = self._predictions.entries.shape
        drawn = detections.entry.tolist()
        annotations = [self._truth.annotations[k] for k in truths.annotation]
        boxes = self._problem.protocol.iou_type == "bbox"
        return Chunk(
            iou_type=self._problem.protocol.iou_type,
            detections=detections,
            truths=truths,
            first_detection=self._first_detection[first : end + 1] - mine.start,
            first_truth=self._first_truth[first : end + 1] - true.start,
            sizes_hw=tuple((i["height"], i["width"]) for i in self._truth.images[first:end]),
            boxes=_boxes(() if isinstance(shape, Texts) else [shape[k] for k in drawn]),
            true_boxes=_boxes([a["bbox"] for a in annotations] if boxes else ()),
            masks=tuple(shape[k] for k in drawn) if isinstance(shape, Texts) else (),
            true_masks=() if boxes else tuple(a["segmentation"] for a in annotations),
        )


def _edges(first_detection: Ints) -> Ints:
    """First images of the chunks, and the number of images: cut where another chunk is full."""
    n_images = len(first_detection) - 1
    full = first_detection[:-1] // _CHUNK_DETECTIONS
    starts = np.flatnonzero(np.diff(full, prepend=-1))
    return np.append(starts, n_images)


def _cut(columns: Columns, some: slice, first_image: int) -> Columns:
    cut = {f.name: getattr(columns, f.name)[some] for f in fields(columns)}
    return replace(columns, **{**cut, "image": cut["image"] - first_image})


def _boxes(boxes: Sequence[Sequence[float]]) -> Floats:
    numbers = list(itertools.chain.from_iterable(boxes))
    return np.array(numbers, np.float64).reshape(-1, 4)
