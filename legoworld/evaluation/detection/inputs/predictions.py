"""Predictions checked entry by entry and put into their order before anything scores them."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.evaluation.detection.inputs.box_formats import check_box_format
from legoworld.evaluation.detection.inputs.caps import without_empty
from legoworld.evaluation.detection.inputs.masks import compressed, covers, measured, rle_problem
from legoworld.evaluation.detection.inputs.prediction_checks import (
    PredictionsInvalidError,
    check_ids,
    check_keys,
    sound_keys,
)
from legoworld.evaluation.detection.inputs.prediction_columns import PredictionColumns, score_column
from legoworld.evaluation.detection.inputs.prediction_order import (
    PredictionOrder,
    in_order,
    order_of,
    places_in_order,
)
from legoworld.evaluation.detection.inputs.texts import Texts, texts_of
from legoworld.evaluation.detection.inputs.truth import Truth
from legoworld.evaluation.detection.protocols import DetectionProtocol
from legoworld.evaluation.run import Run
from legoworld.files import canonical_json
from legoworld.tracks.vocabulary import Vocabulary

CheckBoxes = Callable[[Sequence[dict[str, Any]], Mapping[int, tuple[int, int]]], Mapping[str, int]]


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
        """The same of `with_equal_confidence`."""
        return sha256_of_entries(with_equal_confidence(self).entries)

    @property
    def equally_confident(self) -> bool:
        """Whether no entry is ranked above another, and their order is canonical."""
        if len(set(self.entries.score.tolist())) > 1:
            return False
        places = places_in_order(self.entries, "canonical")
        return self.order == "canonical" or bool((np.diff(places) == 1).all())


def check_predictions(
    entries: Sequence[Any],
    *,
    run: Run,
    truth: Truth,
    protocol: DetectionProtocol,
) -> Predictions:
    """Check a results list against the run's images and the truth's categories.

    PredictionsInvalidError names the first offender and how many there are.
    """
    return check_results(
        entries,
        status_by_image={i.id: i.status for i in run.images},
        sizes_wh={i["id"]: (i["width"], i["height"]) for i in truth.images},
        vocabulary=truth.vocabulary,
        protocol=protocol,
        order=order_of(run.configuration),
    )


def check_results(
    entries: Sequence[Any],
    *,
    status_by_image: Mapping[int, str],
    sizes_wh: Mapping[int, tuple[int, int]],
    vocabulary: Vocabulary,
    protocol: DetectionProtocol,
    order: PredictionOrder = "canonical",
    check_boxes: CheckBoxes = check_box_format,
) -> Predictions:
    """Check a results list against the images of a run and a vocabulary; needs no truth.

    order: what the predictions are put into. check_boxes: `check_box_values` for a part of a run,
    where too few boxes tell their format.
    PredictionsInvalidError names the first offender and how many there are.
    """
    payload = "bbox" if protocol.iou_type == "bbox" else "segmentation"
    if not sound_keys(entries, payload):
        check_keys(entries, payload)
    check_ids(entries, status_by_image, vocabulary)
    warnings: Counter[str] = Counter()
    if payload == "bbox":
        warnings.update(check_boxes(entries, sizes_wh))
        shape: tuple[Any, ...] | Texts = tuple(e["bbox"] for e in entries)
    else:
        shape = texts_of([_counts(e, sizes_wh[e["image_id"]], warnings) for e in entries])
    kept = in_order(
        PredictionColumns(
            image_id=np.array([e["image_id"] for e in entries], np.int64),
            category_id=np.array([e["category_id"] for e in entries], np.int64),
            score=score_column([e["score"] for e in entries]),
            shape=shape,
            sizes_wh=None if payload == "bbox" else sizes_wh,
        ),
        order,
    )
    n_empty = 0
    if payload != "bbox":
        empty = _areas(kept, sizes_wh) == 0
        boxed = sum("bbox" in e for e in entries)
        if boxed:  # both evaluators would take the box's area for the mask's
            warnings["masks with a bbox, which was left out"] = boxed
        if empty.any() and protocol.federated:
            n_empty = int(empty.sum())
            kept = without_empty(kept, empty, protocol.per_image_cap, warnings)
        elif empty.any():
            what = "masks without a pixel, scored as pycocotools does: they match nothing"
            warnings[what] = int(empty.sum())
    return Predictions(
        entries=kept,
        warnings=tuple(f"{count} {what}" for what, count in sorted(warnings.items())),
        n_dropped_empty=n_empty,
        order=order,
    )


def sha256_of_entries(entries: Iterable[dict[str, Any]]) -> str:
    """Hash of entries as JSON, one line each; their text is never in memory as a whole."""
    digest = hashlib.sha256()
    for entry in entries:
        digest.update(f"{canonical_json(entry)}\n".encode())
    return digest.hexdigest()


def with_equal_confidence(predictions: Predictions) -> Predictions:
    """The same predictions, none ranked above another, in canonical order.

    Files mostly list higher scores first: in their own order the ranking would still be there.
    """
    score = score_column([EQUAL_CONFIDENCE] * len(predictions.entries))
    entries = replace(predictions.entries, score=score)
    if predictions.order != "canonical":
        entries = in_order(entries, "canonical")
    return replace(predictions, entries=entries, order="canonical")


def _counts(entry: dict[str, Any], size_wh: tuple[int, int], warnings: Counter[str]) -> str:
    """The compressed counts of an entry's mask."""
    mask = entry["segmentation"]
    problem = rle_problem(mask, size_wh)
    if problem:
        raise _unusable_mask(entry, problem)
    counts: str | list[int] = mask["counts"]
    if isinstance(counts, str):
        return counts
    warnings["masks with uncompressed RLE, compressed before scoring"] += 1
    text: str = compressed(mask, (size_wh[1], size_wh[0]))["counts"].decode("ascii")
    return text


def _areas(
    entries: PredictionColumns, sizes_wh: Mapping[int, tuple[int, int]]
) -> NDArray[np.float64]:
    """(n,) pixels of every mask, once its run lengths add up to its image.

    pycocotools never asks, and reads on behind the end of counts that do not.
    """
    covered, areas = measured(entries.shape)
    pixels = {image_id: width * height for image_id, (width, height) in sizes_wh.items()}
    for index in np.flatnonzero(covered != [pixels[i] for i in entries.image_id.tolist()])[:1]:
        entry = entries[int(index)]
        raise _unusable_mask(entry, covers(int(covered[index]), sizes_wh[entry["image_id"]]))
    return areas


def _unusable_mask(entry: dict[str, Any], problem: str) -> PredictionsInvalidError:
    return PredictionsInvalidError(
        f"a mask of image {entry['image_id']}, category {entry['category_id']} is unusable",
        found=problem,
        expected='{"size": [height, width] of the image, "counts": compressed RLE}',
    )
