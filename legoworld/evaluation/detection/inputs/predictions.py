"""Predictions, checked entry by entry and sorted before scoring."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.evaluation.detection.inputs.box_formats import check_box_format
from legoworld.evaluation.detection.inputs.prediction_checks import check_ids, check_scores
from legoworld.evaluation.detection.inputs.prediction_columns import (
    PredictionColumns,
    Sizes,
    score_column,
)
from legoworld.evaluation.detection.inputs.prediction_order import (
    PredictionOrder,
    configured_order,
    in_order,
    places_in_order,
)
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.payloads.payload import CheckBoxes, Checking
from legoworld.evaluation.detection.protocols import DetectionProtocol
from legoworld.evaluation.run import Run
from legoworld.records.predictions import Box3dPrediction, BoxPrediction, MaskPrediction
from legoworld.tracks.vocabulary import Vocabulary

#: Predictions some at a time; of the kind that the protocol scores (`prediction_type`).
Batches = Iterable[Sequence[BoxPrediction | MaskPrediction | Box3dPrediction]]


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
        return hash_entries(self.entries)

    @property
    def sha256_equally_confident(self) -> str:
        """The same hash for `with_equal_confidence`."""
        return hash_entries(with_equal_confidence(self).entries)

    @property
    def equally_confident(self) -> bool:
        """Whether all scores are equal and the order is canonical."""
        if len(set(self.entries.score.tolist())) > 1:
            return False
        places = places_in_order(self.entries, "canonical")
        return self.order == "canonical" or bool((np.diff(places) == 1).all())


def prediction_type(
    protocol: DetectionProtocol,
) -> type[BoxPrediction] | type[MaskPrediction] | type[Box3dPrediction]:
    """What a protocol scores."""
    return protocol.payload.record


def check_predictions(
    batches: Batches, *, run: Run, truth: Truth, protocol: DetectionProtocol
) -> Predictions:
    """Check predictions, batch after batch, against the run's images and the truth's categories.

    PredictionsInvalidError names the first offender and how many there are.
    """
    return check_results(
        batches,
        status_by_image={i.image_id: i.status for i in run.images},
        sizes_wh=truth.sizes_wh,
        vocabulary=truth.vocabulary,
        protocol=protocol,
        order=configured_order(run.configuration),
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
    payload = protocol.payload
    given = payload.read_columns(batches, sizes_wh)
    columns = given.columns
    check_scores(columns.score)
    check_ids(columns.image_id, columns.category_id, status_by_image, vocabulary)
    warnings: Counter[str] = Counter()
    checking = Checking(
        sizes_wh=sizes_wh,
        protocol=protocol,
        order=order,
        check_boxes=check_boxes,
        warnings=warnings,
    )
    kept, n_empty = payload.check_columns(given, checking)
    return Predictions(
        entries=kept,
        warnings=tuple(f"{n} {what}" for what, n in sorted(warnings.items()) if n),
        n_dropped_empty=n_empty,
        order=order,
    )


def hash_entries(entries: PredictionColumns) -> str:
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
