"""The main metrics of evaluations and comparisons, as a forest plot has them; one as a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec.structs import replace

from legoworld.comparison.family import load_comparison_family
from legoworld.comparison.tables import over_text
from legoworld.evaluation.family import load_evaluation_family
from legoworld.evaluation.metrics import MetricRow
from legoworld.records.comparison import (
    Better,
    Comparison,
    ComparisonRow,
    Difference,
    Measured,
    Pair,
)
from legoworld.records.evaluation import Summary
from legoworld.records.report_tables import ForestRow, Span
from legoworld.report.family import load_page_family
from legoworld.tables.table import line


def forest_rows(
    task: str, sides: Sequence[Summary], comparison: Comparison | None
) -> tuple[ForestRow, ...]:
    """Every side over all attempted images, and the differences of a comparison.

    sides: empty for a comparison alone, whose own numbers are taken then.
    """
    return tuple(_rows(task, sides, comparison))


def evaluated_sentence(name: str, summary: Summary) -> str:
    """One evaluation's first metric with its denominators, as a sentence."""
    metric, label = next(iter(load_page_family(summary.task).forest.items()))
    row = _by_id(summary)[metric]
    value = line(replace(row.number, digits=3)) if row.number.value is not None else "undefined"
    return f"{name}: {label} {value} over {row.over}."


def _by_id(summary: Summary) -> dict[str, MetricRow]:
    parts = load_evaluation_family(summary.task).metrics(summary)
    return {row.id: row for part in parts for row in part.rows}


def _rows(
    task: str, sides: Sequence[Summary], comparison: Comparison | None
) -> Iterator[ForestRow]:
    pairs = comparison.pairs if comparison else ()
    better: dict[str, Better] = {
        metric.id: metric.better for metric in load_comparison_family(task).metrics(task)
    }
    found = [_by_id(side) for side in sides]
    for metric, name in load_page_family(task).forest.items():
        compared = [_row(pair, metric) for pair in pairs]
        spans = [_evaluation_span(side.get(metric)) for side in found]
        if not sides and compared and compared[0]:
            others = (_span(row.baseline if row else None) for row in compared)
            spans = [_span(compared[0].scene), *others]
        if all(span is None or span.value is None for span in spans):
            continue
        yield ForestRow(
            name=name,
            better=better[metric],
            sides=tuple(spans),
            differences=tuple(_comparison_span(*of) for of in zip(pairs, compared, strict=True)),
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
    over = over_text(side) if isinstance(side, Measured) else ""
    return Span(value=side.value, low=low, high=high, over=over)


def _comparison_span(pair: Pair, row: ComparisonRow | None) -> Span | None:
    """The difference, with the images that it is of."""
    if row is None:
        return None
    low, high = row.difference.ends or (None, None)
    of = {"paired": pair.coverage.paired, "attempted": f"all {pair.coverage.attempted}"}
    return Span(
        value=row.difference.value,
        low=low,
        high=high,
        over=f"{of.get(row.images, '')} {row.images}".strip(),
    )


def _evaluation_span(row: MetricRow | None) -> Span | None:
    if row is None:
        return None
    low, high = row.number.ends or (None, None)
    return Span(value=row.number.value, low=low, high=high, over=row.over)
