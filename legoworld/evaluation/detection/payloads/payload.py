"""A payload: what detections of a task have besides category and score, and how it is compared."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.grid import Grid
from legoworld.evaluation.detection.inputs.prediction_columns import (
    GivenColumns,
    PredictionColumns,
    Sizes,
)
from legoworld.evaluation.detection.inputs.prediction_order import PredictionOrder
from legoworld.evaluation.detection.inputs.truth_checks import CheckShapes, Foreign
from legoworld.files import Json
from legoworld.records.coco_file import ShownPrediction, TrueAnnotation, TrueImage
from legoworld.records.detection import SpaceErrors
from legoworld.records.predictions import Box3dPrediction, BoxPrediction, MaskPrediction

if TYPE_CHECKING:
    from legoworld.evaluation.detection.matching.matches import Chunk
    from legoworld.evaluation.detection.protocols import DetectionProtocol

IouType = Literal["bbox", "segm", "bbox3D"]
CheckBoxes = Callable[[Sequence[int], Sequence[Json], Sizes], Mapping[str, int]]
#: A row of view/: an annotation or a prediction.
Row = TrueAnnotation | ShownPrediction


@dataclass(frozen=True, kw_only=True)
class Overlaps:
    """iou: (detections, truths) of every image that has both, one after the other, flat.

    IoU; for a crowd truth, the share of the detection inside it. area: (D,) what the evaluators
    take for a detection's area: of the box, or of the mask.
    """

    iou: NDArray[np.float64]
    area: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Checking:
    """What predictions are checked against. warnings: gains the counted repairs."""

    sizes_wh: Sizes
    protocol: DetectionProtocol
    order: PredictionOrder
    check_boxes: CheckBoxes
    warnings: Counter[str]


@dataclass(frozen=True, kw_only=True)
class Outline:
    """What is drawn of a row: its box, and compressed counts or polygons where it has them.

    hidden: compressed counts of the part of an amodal mask that is not visible.
    """

    box: Sequence[float]
    hidden: str | None = None
    rle: str | None = None
    polygons: Sequence[Sequence[float]] | None = None


@dataclass(frozen=True, kw_only=True)
class Payload:
    """What detections of a task are compared by. Every function is a module's own: workers take it.

    name: of the card's readout.reads; iou_type: as the official evaluators call it; record: what a
    prediction is read as; field: of an annotation, where its shape is.
    read_columns: predictions as columns; check_columns: them in order, and how many were dropped as
    empty, PredictionsInvalidError for others.
    document: a truth file's content in the form that the rest reads, where it may have another one,
    TruthInvalidError.
    check_shapes: annotations of wanted images, by all of the file's images, wherever shapes matter;
    check_format: also, where they are scored. TruthInvalidError.
    pack_shapes: shapes of a chunk as it keeps them; overlaps: of a chunk's detections and truths.
    shape: of a row of view/, in a picture of (height, width), as it is compared; compare_shapes:
    (n, m) overlaps of shapes with others, of which some are crowds, as in `Overlaps`;
    enclose_shapes: the shape that covers several; outline: of a row, in the picture of an image.
    own_ignore: whether `ignore` of annotations counts; most_pairs: of detections and truths in an
    image, None where nothing bounds them; difference: of a row and its truth in words; pair_errors:
    of shapes and their truths.
    """

    name: str
    iou_type: IouType
    grid: Grid
    record: type[BoxPrediction] | type[MaskPrediction] | type[Box3dPrediction]
    field: str
    read_columns: Callable[[Iterable[Sequence[Any]], Sizes], GivenColumns]
    check_columns: Callable[[GivenColumns, Checking], tuple[PredictionColumns, int]]
    pack_shapes: Callable[[Sequence[Any]], Any]
    overlaps: Callable[[Chunk], Overlaps]
    shape: Callable[[Row, tuple[int, int]], Any]
    compare_shapes: Callable[[Any, Any, Sequence[int]], NDArray[np.float64]]
    enclose_shapes: Callable[[Sequence[Any]], Any]
    outline: Callable[[Row, TrueImage], Outline]
    check_shapes: CheckShapes | None = None
    check_format: (
        Callable[[str, Sequence[Foreign], Mapping[int, Foreign], Counter[str]], None] | None
    ) = None
    document: Callable[[Foreign, str], Foreign] | None = None
    own_ignore: bool = False
    most_pairs: int | None = None
    difference: Callable[[Row, Row], str] | None = None
    pair_errors: Callable[[Sequence[Any], Sequence[Any]], SpaceErrors] | None = None
