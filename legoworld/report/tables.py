"""A section's tables: numbers with interval and denominator, coverage, categories, comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.text import metric_rows as detection_metric_rows
from legoworld.evaluation.stored import Evaluated
from legoworld.pluralize import counted, range_text, share
from legoworld.records.base import UNSET
from legoworld.records.comparison import Comparison, Difference, Measured
from legoworld.records.depth import AllAttempted, DepthSummary
from legoworld.records.evaluation_rows import CategoryRow
from legoworld.records.report_tables import (
    CategoryCell,
    CategoryLine,
    ComparedPair,
    ComparedRow,
    CountRow,
    NumberCell,
    NumberRow,
)
from legoworld.report.family import page_of

#: What stands where no specialist's number is.
NO_SPECIALIST: Final = "no specialist was run"


def metric_rows(sides: Sequence[Evaluated]) -> list[NumberRow]:
    """Every metric of any family's summaries, a side a column."""
    found: dict[tuple[str, str | None], list[NumberCell | None]] = {}
    for k, side in enumerate(sides):
        coverage = side.summary.coverage
        over = share(coverage.scored, coverage.attempted, "image", "images")
        for name, policy, value, interval in side.summary.metric_values():
            spread = range_text(interval.ends if interval else None)
            cell = NumberCell(value=_number(value), spread=spread, over=over)
            found.setdefault((name, policy), [None] * len(sides))[k] = cell
    return [
        NumberRow(name=name, policy=policy or UNSET, cells=tuple(cells))
        for (name, policy), cells in found.items()
    ]


def headline_rows(sides: Sequence[Evaluated]) -> list[NumberRow]:
    """The evaluator's own numbers and the tie orders."""
    return [r for r in _detection_rows(sides) if not r.name.startswith("class_")]


def score_free_rows(sides: Sequence[Evaluated]) -> list[NumberRow]:
    """The numbers of one-to-one pairs, which need no ranking, by name."""
    rows = [r for r in _detection_rows(sides) if r.name.startswith("class_")]
    return sorted(rows, key=lambda r: r.name)


def _detection_rows(sides: Sequence[Evaluated]) -> list[NumberRow]:
    found: dict[str, list[NumberCell | None]] = {}
    for k, side in enumerate(sides):
        for name, value, spread, over in detection_metric_rows(
            side.detection, detection_protocol(side.task)
        ):
            cell = NumberCell(value=value, spread=spread, over=over)
            found.setdefault(name, [None] * len(sides))[k] = cell
    return [NumberRow(name=name, cells=tuple(cells)) for name, cells in found.items()]


def depth_rows(sides: Sequence[Evaluated]) -> list[NumberRow]:
    """Means of every metric and hole policy, with the constant depth's beside them."""
    rows = []
    for metric, by_policy in sides[0].depth.metrics.items():
        for policy in by_policy:
            cells = tuple(_depth_cell(side.depth, metric, policy) for side in sides)
            rows.append(NumberRow(name=metric, policy=policy, cells=cells))
    for policy in sides[0].depth.all_attempted.abs_rel:
        cells = tuple(_attempted_cell(side.depth.all_attempted, policy) for side in sides)
        rows.append(NumberRow(name="abs_rel, all attempted", policy=policy, cells=cells))
    return rows


def _depth_cell(summary: DepthSummary, metric: str, policy: str) -> NumberCell:
    groups, coverage = summary.bootstrap, summary.coverage
    scenes = counted(groups.groups, "scene", "scenes")
    by_scene = f", {scenes}" if groups.unit == "scene" else ""
    return NumberCell(
        value=_number(summary.metrics[metric][policy]),
        spread=range_text(summary.intervals[metric][policy].ends),
        over=share(coverage.scored, coverage.attempted, "image", "images") + by_scene,
        constant=_number(summary.constant[metric][policy]),
    )


def _attempted_cell(every: AllAttempted, policy: str) -> NumberCell:
    images = counted(every.images, "image", "images")
    return NumberCell(
        value=_number(every.abs_rel[policy]),
        spread="-",
        over=f"{images} with truth, {every.missing} of them without a score at "
        f"{every.missing_abs_rel:g}",
        constant="-",
    )


def coverage_rows(sides: Sequence[Evaluated]) -> list[CountRow]:
    """Attempted, scored, with truth, and every status, a side a column."""
    coverages = [side.summary.coverage for side in sides]
    names = ["attempted", "scored", "valid", "with_truth", "scored_with_truth"]
    names += ["scored_without_predictions"]
    rows = [
        CountRow(name=name.replace("_", " "), cells=tuple(getattr(c, name, "-") for c in coverages))
        for name in names
        if any(hasattr(c, name) for c in coverages)
    ]
    for status in sorted({s for c in coverages for s in c.by_status}):
        cells = tuple(c.by_status.get(status, 0) for c in coverages)
        rows.append(CountRow(name=f"status {status}", cells=cells))
    return rows


def coverage_notes(side: Evaluated) -> list[str]:
    """The evaluation's own sentences about its counts."""
    return page_of(side.task).notes(side)


def category_rows(sides: Sequence[Evaluated]) -> list[CategoryLine]:
    """A row of each category that has truth or predictions on any side, ascending id."""
    found: dict[int, list[CategoryRow | None]] = {}
    for k, side in enumerate(sides):
        for row in side.categories:
            found.setdefault(row.category_id, [None] * len(sides))[k] = row
    return [_category(found[key]) for key in sorted(found)]


def _category(rows: Sequence[CategoryRow | None]) -> CategoryLine:
    first = next(row for row in rows if row is not None)
    return CategoryLine(
        id=first.category_id,
        name=first.name,
        frequency=None if first.frequency is UNSET else first.frequency,
        n_truth=first.n_truth,
        n_images=first.n_images,
        cells=tuple(
            None
            if row is None
            else CategoryCell(
                ap=row.AP,
                ap50=row.AP50,
                miou=row.miou_gt,
                n=row.n_predictions,
                tp=row.greedy_50.tp,
                fp=row.greedy_50.fp,
            )
            for row in rows
        ),
    )


def comparison_tables(comparison: Comparison) -> list[ComparedPair]:
    """Each pair of a comparison with its rows as text; level 1 is the headline."""
    return [
        ComparedPair(
            scene=pair.scene,
            baseline=pair.baseline,
            coverage=pair.coverage,
            dropped=pair.dropped,
            rows=tuple(
                ComparedRow(
                    name=_short_name(row.metric, row.policy),
                    policy=row.policy.replace("_", " "),
                    images=row.images,
                    better=row.better,
                    level=row.level,
                    scene=_compared(row.scene),
                    baseline=_compared(row.baseline),
                    difference=_compared(row.difference, signed=True),
                )
                for row in pair.rows
            ),
        )
        for pair in comparison.pairs
    ]


def _short_name(metric: str, policy: str) -> str:
    """A metric without the policy, which has a column of its own."""
    return metric.removeprefix(f"{policy}.").removesuffix(f".{policy}")


def _compared(cell: Difference, *, signed: bool = False) -> NumberCell:
    spread, over = range_text(cell.ends, "+" if signed else ""), ""
    if isinstance(cell, Measured):
        if not cell.ends and isinstance(cell.sd, float):
            spread = f"sd {cell.sd:.4f}"
        counts = sorted(cell.over.items(), key=lambda c: (c[0] != "images", c[0]))
        over = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counts)
        if isinstance(cell.constant, float):
            over += f"; a constant: {cell.constant:.4f}"
    return NumberCell(value=_number(cell.value, signed=signed), spread=spread, over=over)


def _number(value: float | None, *, signed: bool = False) -> str:
    if value is None:
        return "-"
    return f"{value:+.4f}" if signed else f"{value:.4f}"
