"""A bench on a page: the score and its three parts, and the section with its cases."""

from __future__ import annotations

from typing import Final

from legoworld.pluralize import share
from legoworld.records.reconstruction_summary import ReconstructionSummary
from legoworld.records.report_summary import Span
from legoworld.report.family import PageFamily
from legoworld.report.forest import spelt, with_ends
from legoworld.report.reconstruction_section import bench_section
from legoworld.report.reconstruction_tables import bench_notes

_SCORES: Final = ("S", "V", "R", "A")


def _sentence(name: str, summary: ReconstructionSummary) -> str:
    coverage = summary.coverage
    valid = share(coverage.valid, coverage.attempted, "case", "cases")
    return f"{name}: S {spelt(_span(summary, 'S'))}, {valid} valid."


def _span(summary: ReconstructionSummary, metric: str) -> Span | None:
    mean = summary.metrics.get(metric)
    if mean is None:
        return None
    return with_ends(mean.value, mean.interval, f"{mean.n} {mean.over}")


PAGE: Final = PageFamily(
    sentence=_sentence,
    forest={name: name for name in _SCORES},
    span=_span,
    fill=bench_section,
    notes=bench_notes,
    by_folder=True,
)
