"""Counts on a page: one sentence, one line of the plot, and tables; no pictures of its own."""

from legoworld.report.family import PageFamily
from legoworld.report.forest import spelt, with_ends


def _span(summary, _metric):
    over = f"{summary.coverage.scored} images"
    return with_ends(summary.mae.value, summary.mae.interval, over)


PAGE = PageFamily(
    sentence=lambda name, summary: f"{name}: mean error {spelt(_span(summary, 'mae'))}.",
    forest={"mae": "mean absolute error"},
    span=_span,
    lower_is_better=frozenset({"mae"}),
)
