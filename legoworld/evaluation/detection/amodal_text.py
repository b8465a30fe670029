"""The numbers of amodal masks as text: besides AP, by occlusion, and beside two controls."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from legoworld.evaluation.detection.amodal_sums import AMODAL_METRICS
from legoworld.evaluation.metrics import MetricPart, MetricRow, number
from legoworld.evaluation.short_text import fraction
from legoworld.records.evaluation_summary import DetectionSummary
from legoworld.tables.table import Table, table

#: What numbers are over: sums of `AmodalSums`.
_OVER: Final = {
    "n_occluded": "annotations with hidden parts",
    "n_occluded_matched": "matched annotations with hidden parts",
    "n_matched": "matched annotations",
    "n_hidden": "wholly hidden annotations",
    "n_order_predicted": "predicted pairs",
    "n_order_truth": "true pairs",
}


def short_amodal(summary: DetectionSummary) -> list[str]:
    """The controls in a line, and what the invisible part scores."""
    if not summary.amodal:
        return []
    controls = summary.amodal.controls
    if not controls:
        return ["no visible masks: no controls, and no number of hidden parts"]
    beside = ", ".join(f"{name} {fraction(one['AP'])}" for name, one in controls.items())
    invisible = fraction(summary.amodal.metrics["invisible_iou"])
    return [f"controls to beat, AP: {beside}; IoU of the invisible part {invisible}"]


def amodal_part(summary: DetectionSummary) -> Iterator[MetricPart]:
    """What AP hides, with intervals."""
    if summary.amodal and summary.amodal.sums:
        rows = []
        for name, value in summary.amodal.metrics.items():
            keys = AMODAL_METRICS[name][1:]
            over = ", ".join(f"{getattr(summary.amodal.sums, k)} {_OVER[k]}" for k in keys)
            shown = number(value, summary.intervals.get(f"amodal.{name}"))
            rows.append(MetricRow(name=f"amodal.{name}", number=shown, over=over))
        yield MetricPart(
            title="Amodal masks: what AP hides",
            rows=rows,
            note="Of pairs within a category at IoU 0.5. visible_fraction_error: lower is better.",
        )


def amodal_tables(summary: DetectionSummary) -> list[Table]:
    """By occlusion, and every number beside those of the controls."""
    if not summary.amodal:
        return []
    levels, controls = summary.amodal.levels, summary.amodal.controls
    own = {**summary.metrics, **summary.amodal.metrics}
    names = list(levels["none"].metrics)
    by_level = table(
        ("hidden", *names, "annotations"),
        [
            (name, *(number(level.metrics[n]) for n in names), level.truth_instances)
            for name, level in levels.items()
        ],
        title="By the hidden share of the annotation",
        notes=("partial: up to a quarter; heavy: more. Annotations of other rows are ignored.",),
    )
    beside = table(
        ("metric", "run", *controls),
        [
            (name, number(own[name]), *(number(one[name]) for one in controls.values()))
            for name in next(iter(controls.values()), {})
        ],
        title="Controls: amodal masks replaced by the visible ones, or by their convex hulls",
        notes=("A result has to beat both.",),
    )
    return [by_level, *[beside] * bool(controls)]
