"""An evaluation of label maps as text: numbers with their denominators, and a table of classes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from legoworld.evaluation.family import EvaluationFamily
from legoworld.evaluation.label_maps.evaluate import evaluate_maps, verify_maps
from legoworld.evaluation.label_maps.family import MapFamily
from legoworld.evaluation.metrics import (
    MetricPart,
    MetricRow,
    bounds,
    describe_evaluator,
    first_few,
    fraction,
    image_counts,
    number_cell,
)
from legoworld.pluralize import plural
from legoworld.records.label_maps import LabelMapSummary
from legoworld.tables.table import Cell, Column, Number, Table

#: The denominator of a metric, from a summary and the metric's name.
Over = Callable[[LabelMapSummary, str], str]


def map_evaluation(family: MapFamily, over: Over) -> EvaluationFamily:
    """The evaluation of a family. over: what each metric is over, in words."""
    return EvaluationFamily(
        evaluate=partial(evaluate_maps, family),
        verify=partial(verify_maps, family),
        short=partial(_short, family, over),
        metrics=partial(_metrics, family, over),
        tables=partial(_tables, family),
        notes=_notes,
    )


def _short(family: MapFamily, over: Over, summary: LabelMapSummary) -> str:
    first, *others = (name for name in family.metrics if name in family.headline)
    value, interval = summary.metrics[first], summary.intervals.get(first)
    rest = ", ".join(f"{name} {fraction(summary.metrics[name])}" for name in others)
    lines = [
        f"{describe_evaluator(summary)}: {image_counts(summary.coverage)}",
        f"{first} {fraction(value)}{bounds(interval)}, {rest} over {over(summary, first)}",
    ]
    many = first_few(summary.not_answered, "image without an answer", "images without an answer")
    if summary.partial:
        many.append("partial run: only some images of its track were attempted")
    return "\n".join([*lines, *many])


def _metrics(family: MapFamily, over: Over, summary: LabelMapSummary) -> list[MetricPart]:
    rows = [
        MetricRow(
            name=name,
            number=number_cell(value, summary.intervals.get(name)),
            over=over(summary, name),
        )
        for name, value in summary.metrics.items()
    ]
    return [MetricPart(title="Every metric", rows=rows, note=family.note)]


def _tables(family: MapFamily, summary: LabelMapSummary) -> list[Table]:
    names: Sequence[str] = list(summary.categories[0].values) if summary.categories else []
    columns = ["category", *names, *family.columns]
    rows: list[tuple[Cell, ...]] = [
        (
            category.name,
            *(Number(value=category.values[name]) for name in names),
            *map(str, category.counts),
        )
        for category in summary.categories
    ]
    return [
        Table(
            columns=tuple(Column(name=name) for name in columns),
            rows=tuple(rows),
            title="Categories",
            folded=True,
        )
    ]


def _notes(summary: LabelMapSummary) -> list[str]:
    lines = [*summary.not_answered]
    if summary.missed:
        images = plural(summary.missed, "image", "images")
        lines.insert(0, f"{images} without an answer: all of their ground truth counts as missed")
    return lines + ["partial run: only some images of its track"] * summary.partial
