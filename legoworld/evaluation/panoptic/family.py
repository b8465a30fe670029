"""Panoptic segments as a family of evaluations."""

from __future__ import annotations

from typing import Final

from legoworld.evaluation.label_maps.family import MapFamily
from legoworld.evaluation.label_maps.text import map_evaluation
from legoworld.evaluation.panoptic.quality import (
    METRICS,
    category_values,
    measure_segments,
    panoptic_values,
)
from legoworld.evaluation.panoptic.truth import find_segments
from legoworld.pluralize import plural
from legoworld.records.label_maps import LabelMapSummary
from legoworld.tasks.shipped import PANOPTIC

MAPS: Final = MapFamily(
    family=PANOPTIC,
    noun="segments",
    metrics=METRICS,
    headline=("PQ", "PQ_things", "PQ_stuff"),
    find_truth=find_segments,
    measure=measure_segments,
    values=panoptic_values,
    of_category=category_values,
    columns=("TP", "FP", "FN"),
    note="PQ = SQ x RQ of each category, averaged over the categories with truth or prediction: "
    "the IoU of matches, summed, divided by (TP + FP/2 + FN/2). A match has IoU above 0.5. An "
    "image without an answer is all VOID.",
)


def _over(summary: LabelMapSummary, name: str) -> str:
    wanted = {"things": (True,), "stuff": (False,)}.get(name.partition("_")[2], (True, False))
    counted = [c for c in summary.categories if c.isthing in wanted]
    true = sum(c.counts[0] + c.counts[2] for c in counted)
    categories = plural(len(counted), "category", "categories")
    return f"{categories}, {plural(true, 'true segment', 'true segments')}"


EVALUATION: Final = map_evaluation(MAPS, _over)
