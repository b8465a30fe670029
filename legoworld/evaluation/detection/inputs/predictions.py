"""Predictions, checked entry by entry and sorted before scoring."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.evaluation.detection.inputs.box_formats import check_box_format
from legoworld.evaluation.detection.inputs.caps import without_empty
from legoworld.evaluation.detection.inputs.masks import covers, measured
from legoworld.evaluation.detection.inputs.prediction_checks import (
    check_ids,
    check_scores,
    unusable_mask,
)
from legoworld.evaluation.detection.inputs.prediction_columns import (
    GivenColumns,
    PredictionColumns,
    Sizes,
    boxes_of,
    masks_of,
    score_column,
)
from legoworld.evaluation.detection.inputs.prediction_order import (
    PredictionOrder,
    in_order,
    order_of,
    places_in_order,
)
from legoworld.evaluation.detection.inputs.texts import Texts
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.protocols import DetectionProtocol
from legoworld.evaluation.run import Run
from legoworld.records.predictions import BoxPrediction, MaskPrediction
from legoworld.tracks.vocabulary import Vocabulary

#: Predictions some at a time; of the kind that the protocol scores (`kind_of`).
Batches = Iterable[Sequence[BoxPrediction | MaskPrediction]]

_UNCOMPRESSED: Final = "masks with uncompressed RLE, compressed before scoring"
#: Both evaluators would take the box's area for the mask's.
_BOXED: Final = "masks with a bbox, which was left out"

CheckBoxes = Callable[[Sequence[int], Sequence[object], Sizes], Mapping[str, int]]


@dataclass(frozen=True, kw_only=True)
class Predictions:
    """Checked results by ascending image id, and inside an image in their `order`.

    entries: {"image_id", "category_id", "score"} and "bbox" or "segmentation", nothing else.
    warnings: counted repairs. n_dropped_empty: masks without a pixel, dropped as lvis does.
    """

    entries: PredictionColumns
    warnings: tuple[str, ...]
    n_dropped_empty: int
    order: PredictionOrder = "canonical"

    @property
    def sha256(self) -> str:
        """Hash of the entries as JSON, one line each."""
        return sha256_of_entries(self.entries)

    @property
    def sha256_equally_confident(self) -> str:
        """The same hash for `with_equal_confidence`."""
        return sha256_of_entries(with_equal_confidence(self).entries)

    @property
    def equally_confident(self) -> bool:
        """Whether all scores are equal and the order is canonical."""
        if len(set(self.entries.score.tolist())) > 1:
            return False
        places = places_in_order(self.entries, "canonical")
        return self.order == "canonical" or bool((np.diff(places) == 1).all())


def kind_of(protocol: DetectionProtocol) -> type[BoxPrediction] | type[MaskPrediction]:
    """What a protocol scores."""
    return BoxPrediction if protocol.iou_type == "bbox" else MaskPrediction


def check_predictions(
    batches: Batches,
    *,
    run: Run,
    truth: Truth,
    protocol: DetectionProtocol,
) -> Predictions:
    """Check predictions, batch after batch, against the run's images and the truth's categories.

    PredictionsInvalidError names the first offender and how many there are.
    """
    return check_results(
        batches,
        status_by_image={i.image_id: i.status for i in run.images},
        sizes_wh={i["id"]: (i["width"], i["height"]) for i in truth.images},
        vocabulary=truth.vocabulary,
        protocol=protocol,
        order=order_of(run.configuration),
    )


def check_results(
    batches: Batches,
    *,
    status_by_image: Mapping[int, str],
    sizes_wh: Sizes,
    vocabulary: Vocabulary,
    protocol: DetectionProtocol,
    order: PredictionOrder = "canonical",
    check_boxes: CheckBoxes = check_box_format,
) -> Predictions:
    """Check predictions against the images of a run and a vocabulary; needs no truth.

    order: what the predictions are put into. check_boxes: `check_box_values` for a part of a run,
    where too few boxes tell their format.
    PredictionsInvalidError names the first offender and how many there are.
    """
    boxes = protocol.iou_type == "bbox"
    if boxes:
        given = boxes_of(cast("Iterable[Sequence[BoxPrediction]]", batches))
    else:
        given = masks_of(cast("Iterable[Sequence[MaskPrediction]]", batches), sizes_wh)
    columns = given.columns
    check_scores(columns.score)
    check_ids(columns.image_id, columns.category_id, status_by_image, vocabulary)
    warnings: Counter[str] = Counter()
    if boxes:
        warnings.update(check_boxes(columns.image_id.tolist(), columns.shape, sizes_wh))
        kept, n_empty = in_order(columns, order), 0
    else:
        _check_sizes(given, sizes_wh)
        kept, n_empty = _masks_checked(in_order(columns, order), sizes_wh, protocol, warnings)
        warnings[_UNCOMPRESSED] = given.n_uncompressed
        warnings[_BOXED] = given.n_boxed
    return Predictions(
        entries=kept,
        warnings=tuple(f"{n} {what}" for what, n in sorted(warnings.items()) if n),
        n_dropped_empty=n_empty,
        order=order,
    )


def _masks_checked(
    masks: PredictionColumns, sizes_wh: Sizes, protocol: DetectionProtocol, warnings: Counter[str]
) -> tuple[PredictionColumns, int]:
    """The masks that are scored, and how many without a pixel were dropped."""
    empty = _areas(masks, sizes_wh) == 0
    if not empty.any():
        return masks, 0
    if protocol.federated:
        kept = without_empty(masks, empty, protocol.per_image_cap, warnings)
        return kept, int(empty.sum())
    what = "masks without a pixel, scored as pycocotools does: they match nothing"
    warnings[what] = int(empty.sum())
    return masks, 0


def sha256_of_entries(entries: PredictionColumns) -> str:
    """Hash of entries as JSON, one line each; their text is never in memory as a whole."""
    digest = hashlib.sha256()
    for line in entries.lines():
        digest.update(f"{line}\n".encode())
    return digest.hexdigest()


def with_equal_confidence(predictions: Predictions) -> Predictions:
    """The same predictions with equal scores, in canonical order.

    Files usually list higher scores first, so their own order would keep the ranking.
    """
    score = score_column([EQUAL_CONFIDENCE] * len(predictions.entries))
    entries = replace(predictions.entries, score=score)
    if predictions.order != "canonical":
        entries = in_order(entries, "canonical")
    return replace(predictions, entries=entries, order="canonical")


def _check_sizes(given: GivenColumns, sizes_wh: Sizes) -> None:
    """PredictionsInvalidError for a mask of another size than its image."""
    columns = given.columns
    images, place = np.unique(columns.image_id, return_inverse=True)
    expected = np.array([sizes_wh[i][::-1] for i in images.tolist()], np.int64).reshape(-1, 2)
    wrong = np.flatnonzero((given.size_hw != expected[place]).any(axis=1))
    for index in wrong[:1].tolist():
        size, wanted = given.size_hw[index].tolist(), expected[place[index]].tolist()
        problem = f"size {size}, the image's [height, width] is {wanted}"
        raise unusable_mask(int(columns.image_id[index]), int(columns.category_id[index]), problem)


def _areas(entries: PredictionColumns, sizes_wh: Sizes) -> NDArray[np.float64]:
    """(n,) pixels of every mask, once its run lengths add up to its image.

    pycocotools does not check this, and reads beyond the end of invalid counts.
    """
    assert isinstance(entries.shape, Texts)
    covered, areas = measured(entries.shape)
    images, place = np.unique(entries.image_id, return_inverse=True)
    sizes = [sizes_wh[i] for i in images.tolist()]
    pixels = np.array([width * height for width, height in sizes], np.int64)
    for index in np.flatnonzero(covered != pixels[place])[:1].tolist():
        problem = covers(int(covered[index]), sizes[place[index]])
        raise unusable_mask(int(entries.image_id[index]), int(entries.category_id[index]), problem)
    return areas
