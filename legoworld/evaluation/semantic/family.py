"""Semantic maps as a family of evaluations."""

from __future__ import annotations

from typing import Final

from legoworld.evaluation.label_maps.family import MapFamily
from legoworld.evaluation.label_maps.text import map_evaluation
from legoworld.evaluation.semantic.confusion import (
    METRICS,
    category_values,
    measure_classes,
    semantic_values,
)
from legoworld.evaluation.semantic.truth import find_classes
from legoworld.pluralize import plural
from legoworld.records.label_maps import LabelMapSummary
from legoworld.tasks.shipped import SEMANTIC

MAPS: Final = MapFamily(
    family=SEMANTIC,
    noun="classes",
    metrics=METRICS,
    headline=("mIoU", "aAcc"),
    find_truth=find_classes,
    measure=measure_classes,
    values=semantic_values,
    of_category=category_values,
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
