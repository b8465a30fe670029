"""Depth on a page: the main metrics, and the section with its photos."""

from __future__ import annotations

from typing import Final

from legoworld.evaluation.stored import Evaluated
from legoworld.pluralize import share
from legoworld.records.depth import DepthSummary
from legoworld.records.report_summary import Span
from legoworld.report.depth_section import depth_section
from legoworld.report.family import PageFamily
from legoworld.report.forest import spelt, with_ends

_METRICS: Final = {
    "abs_rel.error_1": "AbsRel",
    "abs_rel.exclude": "AbsRel, holes left out",
    "delta1.error_1": "delta1",
    "delta2.error_1": "delta2",
    "delta3.error_1": "delta3",
}


def _sentence(name: str, summary: DepthSummary) -> str:
    coverage = summary.coverage
    images = f"{share(coverage.scored, coverage.attempted, 'image', 'images')} scored"
    return f"{name}: AbsRel {spelt(_span(summary, 'abs_rel.error_1'))}, {images}."


def _span(summary: DepthSummary, metric: str) -> Span | None:
    name, _, policy = metric.partition(".")
    if policy not in summary.metrics.get(name, {}):
        return None
    coverage = summary.coverage
    over = share(coverage.scored, coverage.attempted, "image", "images")
    return with_ends(summary.metrics[name][policy], summary.intervals[name][policy], over)


def _notes(side: Evaluated) -> list[str]:
    summary = side.depth
    lines = [
        f"mean share of holes {_number(summary.mean_hole_share)}, outside the view "
        f"{_number(summary.mean_outside_view_share)}, clamped "
        f"{_number(summary.mean_clamped_share)}",
        f"{summary.resampled} resampled, {summary.worse_than_constant} worse than a constant",
    ]
    lines += [f"{r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored]
    return lines + (["partial run: only some images of its track"] if summary.partial else [])


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


PAGE: Final = PageFamily(
    sentence=_sentence,
    forest=_METRICS,
    span=_span,
    lower_is_better=frozenset(name for name in _METRICS if name.startswith("abs_rel")),
    fill=depth_section,
    notes=_notes,
)
