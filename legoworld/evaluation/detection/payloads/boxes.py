"""Boxes: x, y, width, height, overlapped by pycocotools' own function."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as _mask

from legoworld.evaluation.detection.grid import PICTURE
from legoworld.evaluation.detection.inputs.masks import EncodedMask
from legoworld.evaluation.detection.inputs.prediction_columns import (
    GivenColumns,
    PredictionColumns,
    number_columns,
)
from legoworld.evaluation.detection.inputs.prediction_order import in_order
from legoworld.evaluation.detection.inputs.truth_checks import check_boxes
from legoworld.evaluation.detection.payloads.payload import (
    Checking,
    Outline,
    Overlaps,
    Payload,
    Row,
)
from legoworld.records.coco_file import TrueImage
from legoworld.records.predictions import BoxPrediction

if TYPE_CHECKING:
    from legoworld.evaluation.detection.matching.matches import Chunk

_API: Any = _mask  # its stubs do not know lists of RLE
#: (n, 4) boxes x, y, w, h, or n compressed masks.
Shapes = NDArray[np.float64] | list[EncodedMask]


def overlaps(detections: Shapes, truths: Shapes, crowd: Sequence[int]) -> NDArray[np.float64]:
    """(detections, truths) IoU, at least one of each; of crowds, the detection's share."""
    return np.asarray(_API.iou(detections, truths, list(crowd)), np.float64)


def _check_columns(given: GivenColumns, checking: Checking) -> tuple[PredictionColumns, int]:
    columns = given.columns
    odd = checking.check_boxes(columns.image_id.tolist(), columns.shape, checking.sizes_wh)
    checking.warnings.update(odd)
    return in_order(columns, checking.order), 0


def _pack_boxes(boxes: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    numbers = list(itertools.chain.from_iterable(boxes))
    return np.array(numbers, np.float64).reshape(-1, 4)


def _overlaps(chunk: Chunk) -> Overlaps:
    first_detection, first_truth = chunk.first_detection.tolist(), chunk.first_truth.tolist()
    crowd = chunk.truths.crowd.astype(int).tolist()
    boxes, true_boxes = chunk.shapes, chunk.true_shapes
    ious = []
    for i in range(len(chunk.sizes_hw)):
        mine = slice(first_detection[i], first_detection[i + 1])
        true = slice(first_truth[i], first_truth[i + 1])
        if mine.start < mine.stop and true.start < true.stop:
            ious.append(overlaps(boxes[mine], true_boxes[true], crowd[true]))
    return Overlaps(
        iou=np.concatenate([*(iou.ravel() for iou in ious), np.empty(0)]),
        area=boxes[:, 2] * boxes[:, 3],
    )


def _shape(row: Row, _size_hw: tuple[int, int]) -> list[float]:
    return list(row.bbox or ())


def _enclose_boxes(boxes: Sequence[Sequence[float]]) -> list[float]:
    """The box around boxes."""
    low = np.array(boxes)[:, :2]
    high = low + np.array(boxes)[:, 2:]
    corner = low.min(0)
    return [*corner.tolist(), *(high.max(0) - corner).tolist()]


def _outline(row: Row, _image: TrueImage) -> Outline:
    return Outline(box=row.bbox or ())


BOXES: Final = Payload(
    name="boxes",
    iou_type="bbox",
    grid=PICTURE,
    record=BoxPrediction,
    field="bbox",
    read_columns=partial(number_columns, "bbox"),
    check_columns=_check_columns,
    check_format=check_boxes,
    pack_shapes=_pack_boxes,
    overlaps=_overlaps,
    shape=_shape,
    compare_shapes=overlaps,
    enclose_shapes=_enclose_boxes,
    outline=_outline,
)
