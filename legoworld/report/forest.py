"""The main metrics of evaluations and comparisons, as a forest plot has them; one as a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from legoworld.records.comparison import Comparison, ComparisonRow, Difference, Measured, Pair
from legoworld.records.evaluation_summary import Interval, Summary
from legoworld.records.report_summary import ForestRow, Span
from legoworld.report.family import page_of


def forest_rows(
    task: str, sides: Sequence[Summary], comparison: Comparison | None
) -> tuple[ForestRow, ...]:
    """Every side over all attempted images, and the differences of a comparison.

    sides: empty for a comparison alone, whose own numbers are taken then.
    """
    return tuple(_rows(task, sides, comparison))


def evaluated_sentence(name: str, summary: Summary) -> str:
    """One evaluation's first metric with its denominators, as a sentence."""
    return page_of(summary.task).sentence(name, summary)


def spelt(span: Span | None) -> str:
    """A number with its interval: 0.588 [0.477, 0.708]."""
    if span is None or span.value is None:
        return "undefined"
    ends = "" if span.low is None else f" [{span.low:.3f}, {span.high:.3f}]"
    return f"{span.value:.3f}{ends}"


def _rows(
    task: str, sides: Sequence[Summary], comparison: Comparison | None
) -> Iterator[ForestRow]:
    pairs = comparison.pairs if comparison else ()
    page = page_of(task)
    for metric, name in page.forest.items():
        compared = [_row(pair, metric) for pair in pairs]
        spans = [page.span(side, metric) for side in sides]
        if not sides and compared and compared[0]:
            others = (_span(row.baseline if row else None) for row in compared)
            spans = [_span(compared[0].scene), *others]
        if all(span is None or span.value is None for span in spans):
            continue
        yield ForestRow(
            name=name,
            better="lower" if metric in page.lower_is_better else "higher",
            sides=tuple(spans),
            differences=tuple(_span(row.difference if row else None) for row in compared),
        )


def _row(pair: Pair, metric: str) -> ComparisonRow | None:
    """A metric's row over all attempted images, or over those of both sides."""
    for images in ("attempted", "scored", "paired"):
        for row in pair.rows:
            if row.metric == metric and row.images == images:
                return row
    return None


def _span(side: Difference | None) -> Span | None:
    if side is None:
        return None
    low, high = side.ends or (None, None)
    over = ""
    if isinstance(side, Measured):
        over = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in sorted(side.over.items()))
    return Span(value=side.value, low=low, high=high, over=over)


def with_ends(value: float | None, known: Interval | None, over: str) -> Span:
    """A number of an evaluation as the plot has it."""
    low, high = (known.ends if known else None) or (None, None)
    return Span(value=value, low=low, high=high, over=over)
