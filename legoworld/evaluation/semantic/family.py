"""The confusion of an image's classes in integers, and mIoU and others of their sums.

Semantic maps as a family of evaluations.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.label_maps.family import (
    F64,
    MapFamily,
    MapInvalidError,
    MapItem,
    Measured,
    average_defined,
    in_order,
    ratio,
)
from legoworld.evaluation.label_maps.png import check_size, label_map_view, read_values, shrink_map
from legoworld.evaluation.label_maps.text import map_evaluation
from legoworld.evaluation.semantic.truth import find_classes, load_classes
from legoworld.pluralize import plural
from legoworld.readouts.label_maps import NO_CLASS, agreement_picture, category_picture
from legoworld.records.label_maps import LabelMapSummary
from legoworld.tasks.shipped import SEMANTIC

METRICS: Final = ("mIoU", "fwIoU", "mAcc", "aAcc")


def measure_classes(item: MapItem) -> Measured:
    """An image's pixels by class; without an answer no pixel has a class."""
    truth = load_classes(item.truth, item.rules, item.category_ids)
    answer = np.full_like(truth, NO_CLASS)
    if item.path is not None:
        answer = read_values(item.path, MapInvalidError)
        check_size(item.path, answer, truth.shape, MapInvalidError)
    ids = np.array(item.category_ids, np.int64)
    table = confusion(truth, answer, ids)
    columns = np.stack([np.diagonal(table), table.sum(axis=1), table.sum(axis=0)[:-1]], axis=1)
    counts = {
        number: (hit, true, answered)
        for number, (hit, true, answered) in zip(ids.tolist(), columns.tolist(), strict=True)
        if true or answered
    }
    small_truth, small = shrink_map(truth), shrink_map(answer)
    scored = np.isin(small_truth, ids)
    view = label_map_view(
        truth.shape,
        truth=category_picture(np.where(scored, small_truth, NO_CLASS)),
        answer=category_picture(small),
        agreement=agreement_picture(small_truth, small, scored),
    )
    n_truth = sum(counts[number][1] > 0 for number in counts)
    return Measured(n_truth=n_truth, counts=counts, view=view)


def confusion(
    truth: NDArray[np.uint8], answer: NDArray[np.uint8], ids: NDArray[np.int64]
) -> NDArray[np.int64]:
    """(K, K + 1) pixels by class of truth and of answer; the last column is of no class.

    Pixels whose truth has no class are left out.
    """
    none = len(ids)
    place = np.full(256, none, np.int64)
    place[ids] = np.arange(none)
    code = place[truth].ravel() * (none + 1) + place[answer].ravel()
    table = np.bincount(code, minlength=(none + 1) ** 2).reshape(none + 1, none + 1)
    return table[:none]


def semantic_values(sums: F64, _things: NDArray[np.bool_]) -> dict[str, F64]:
    """The metrics of sums (..., K, 4): mean and frequency-weighted IoU, mean and pixel accuracy."""
    hit, truth = sums[..., 1], sums[..., 2]
    of = category_values(sums)
    every = truth.sum(axis=-1)
    weighted = np.where(truth > 0, truth * np.nan_to_num(of["IoU"]), 0.0)
    return {
        "mIoU": average_defined(of["IoU"], ~np.isnan(of["IoU"])),
        "fwIoU": ratio(in_order(weighted), every),
        "mAcc": average_defined(of["Acc"], truth > 0),
        "aAcc": ratio(hit.sum(axis=-1), every),
    }


def category_values(sums: F64) -> dict[str, F64]:
    """(..., K) IoU and accuracy of classes, NaN where union, or truth, has no pixel."""
    hit, truth, answer = (sums[..., k] for k in (1, 2, 3))
    return {"IoU": ratio(hit, truth + answer - hit), "Acc": ratio(hit, truth)}


MAPS: Final = MapFamily(
    family=SEMANTIC,
    noun="classes",
    metrics=METRICS,
    headline=("mIoU", "aAcc"),
    find_truth=find_classes,
    measure=measure_classes,
    values=semantic_values,
    category_values=category_values,
    columns=("hit px", "true px", "answered px"),
    note="One confusion matrix over all pixels with a true class. mIoU: IoU of each class, "
    "averaged over those with truth or answer; fwIoU: weighted by true pixels; mAcc: share of a "
    "class's true pixels that are right, averaged over those with truth; aAcc: of all pixels. A "
    "pixel without an answer is missed and no false answer.",
)


def _over(summary: LabelMapSummary, name: str) -> str:
    classes = [c for c in summary.categories if c.counts[1] or not name.endswith("Acc")]
    pixels = sum(c.counts[1] for c in summary.categories)
    return f"{plural(len(classes), 'class', 'classes')}, {plural(pixels, 'pixel', 'pixels')}"


EVALUATION: Final = map_evaluation(MAPS, _over)
