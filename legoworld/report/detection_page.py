"""Boxes and masks on a page: the main metrics, and the section with its photos."""

from __future__ import annotations

from typing import Final

from legoworld.evaluation.detection.text import notes
from legoworld.pluralize import counted, share
from legoworld.records.evaluation_summary import DetectionSummary
from legoworld.records.report_summary import Span
from legoworld.report.detection_section import detection_section
from legoworld.report.family import PageFamily
from legoworld.report.forest import spelt, with_ends

_METRICS: Final = {
    "AP": "AP",
    "AP50": "AP50",
    "AP75": "AP75",
    "APs": "AP small",
    "APm": "AP medium",
    "APl": "AP large",
    "equal_confidence.AP": "AP, equal confidence",
    "class_aware.miou_gt_micro": "mean IoU per object",
    "class_aware.recall_50": "recall at IoU 0.5",
    "class_aware.precision_50": "precision at IoU 0.5",
}


def _sentence(name: str, summary: DetectionSummary) -> str:
    coverage, counts = summary.coverage, summary.counts
    images = f"{share(coverage.scored, coverage.attempted, 'image', 'images')} scored"
    objects = counted(counts.truth_instances, "annotated object", "annotated objects")
    categories = counted(counts.categories_with_truth, "category", "categories")
    value = spelt(_span(summary, "AP"))
    return f"{name}: AP {value} over {objects} in {categories}, {images}."


def _span(summary: DetectionSummary, metric: str) -> Span | None:
    kind, _, name = metric.rpartition(".")
    counts = summary.counts
    over = (
        f"{counted(summary.coverage.attempted, 'image', 'images')}, "
        f"{counted(counts.truth_instances, 'object', 'objects')}"
    )
    if kind == "equal_confidence":
        value = summary.equal_confidence.metrics[name]
        known = summary.intervals.get(name) if summary.equal_confidence.already_equal else None
    elif kind == "class_aware":
        value = summary.matched.class_aware.values()[name]
        known = summary.intervals.get(metric)
        if name == "precision_50":
            over = counted(counts.predictions, "prediction", "predictions")
    else:
        value, known = summary.metrics.get(name), summary.intervals.get(name)
    return with_ends(value, known, over)


PAGE: Final = PageFamily(
    sentence=_sentence,
    forest=_METRICS,
    span=_span,
    fill=detection_section,
    notes=lambda side: notes(side.detection),
)
