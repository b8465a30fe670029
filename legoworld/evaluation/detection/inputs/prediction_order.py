"""The order of equally confident predictions (docs/protocols/ties.md), and the evaluators' caps."""

from __future__ import annotations

from collections import Counter
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.inputs.prediction_columns import Ints, PredictionColumns
from legoworld.records.predictions import Prediction
from legoworld.records.run_file import Configuration


def rank_in_group(sorted_groups: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) position in its run of equal values, from 0."""
    if not len(sorted_groups):
        return np.empty(0, np.int64)
    starts = np.flatnonzero(np.diff(sorted_groups, prepend=sorted_groups[0] - 1))
    sizes = np.diff(starts, append=len(sorted_groups))
    return np.arange(len(sorted_groups)) - np.repeat(starts, sizes)


def without_empty(
    entries: PredictionColumns, empty: NDArray[np.bool_], cap: int | None, warnings: Counter[str]
) -> PredictionColumns:
    """The entries that have a pixel, and that lvis keeps beside those that have none.

    lvis counts masks without a pixel among an image's first `cap` and drops them afterwards: what
    they push over the cap is dropped here, because evaluation no longer sees them. empty: (n,).
    """
    kept = ~empty
    if cap is not None:
        image, score = entries.image_id, entries.score.astype(np.float64)
        crowded = np.isin(image, image[empty])
        by_rank = np.lexsort((np.arange(len(entries)), -score, image))
        within = np.empty(len(entries), bool)
        within[by_rank] = rank_in_group(image[by_rank]) < cap
        pushed = kept & crowded & ~within
        if pushed.any():
            warnings["masks lost to the cap beside masks without a pixel"] = int(pushed.sum())
        kept &= ~pushed
    return entries.take(np.flatnonzero(kept))


#: canonical: by image id, category id, payload. given: by image id, then as the predictions were
#: given, which is the order of an imported file or of a model's own answer.
PredictionOrder = Literal["canonical", "given"]

#: float64 holds every integer up to here.
_EXACT: Final = 2.0**53


def configured_order(configuration: Configuration) -> PredictionOrder:
    """The order of a run's predictions, from the run's configuration."""
    return "given" if configuration.prediction_order == "given" else "canonical"


def in_order(predictions: PredictionColumns, order: PredictionOrder) -> PredictionColumns:
    """The predictions in one of the two orders.

    Sorting by image alone, and stably, changes no result: both official evaluators go through the
    images by ascending id, and break ties by place in the file only inside an image.
    """
    return predictions.take(places_in_order(predictions, order))


def places_in_order(predictions: PredictionColumns, order: PredictionOrder) -> Ints:
    """(n,) the position of the first, the second, ... of an order."""
    if order == "given":
        return np.argsort(predictions.image_id, kind="stable")
    if predictions.sizes_wh is not None:
        return _masks_in_order(predictions)
    boxes = np.array(predictions.shape, np.float64).reshape(
        len(predictions), 24 if predictions.field == "bbox3D" else 4
    )
    score = predictions.score.astype(np.float64)
    if max(np.abs(boxes).max(initial=0), np.abs(score).max(initial=0)) > _EXACT:
        entries = list(predictions)
        return np.array(sorted(range(len(entries)), key=lambda k: canonical_key(entries[k])))
    keys = (-score, *boxes.T[::-1], predictions.category_id, predictions.image_id)
    places: Ints = np.lexsort(keys).astype(np.int64)
    return places


def _masks_in_order(predictions: PredictionColumns) -> Ints:
    """Canonical: by arrays as far as an image and category, by their texts within one."""
    places: Ints = np.lexsort((predictions.category_id, predictions.image_id)).astype(np.int64)
    image, category = predictions.image_id[places], predictions.category_id[places]
    edges = np.flatnonzero((np.diff(image) != 0) | (np.diff(category) != 0)) + 1
    bounds = np.concatenate([[0], edges, [len(places)]])
    shape, score = predictions.shape, predictions.score.tolist()
    for k in np.flatnonzero(np.diff(bounds) > 1):
        cell = places[bounds[k] : bounds[k + 1]]
        cell[:] = sorted(cell.tolist(), key=lambda p: (shape[p], -score[p]))
    return places


def canonical_key(prediction: Prediction) -> tuple[Any, ...]:
    """Image id, category id, payload (numbers or RLE characters), higher score first."""
    mask = prediction.segmentation
    payload = mask.counts if mask else prediction.corners or prediction.bbox
    return prediction.image_id, prediction.category_id, payload, -prediction.score
