"""A section's tables: numbers with interval and denominator, coverage, categories, comparison."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from legoworld.comparison.tables import number, over_text
from legoworld.evaluation.family import load_evaluation_family
from legoworld.evaluation.metrics import metric_tables
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.base import UNSET
from legoworld.records.comparison import Comparison, ComparisonRow, Measured, Pair
from legoworld.records.detection import CategoryRow
from legoworld.records.report_tables import (
    CategoryCell,
    CategoryLine,
    ComparedPair,
    PageSection,
)
from legoworld.tables.table import Cell, Column, Count, Number, Table, Text, table

#: What stands where no specialist's number is.
NO_SPECIALIST: Final = "no specialist was run"
#: Titles of a comparison's rows by their level; the first are shown, the others folded.
_LEVELS: Final = {1: "", 2: "more rows", 3: "rows that the CSV has, too"}


def number_tables(sides: Sequence[StoredEvaluation]) -> list[Table]:
    """Every number of every summary, a side after the other."""
    family = load_evaluation_family(sides[0].task)
    return metric_tables([(side.name, family.metrics(side.summary)) for side in sides])


def tasks_table(sections: Sequence[PageSection]) -> Table:
    """Every task's first main metric, a side a row, with its own evaluator and denominators."""
    rows: list[list[Cell]] = []
    for section in sections:
        first = next(iter(section.first.forest), None)
        spans = first.sides if first else (None,) * len(section.sides)
        for side, evaluator, span in zip(section.sides, section.evaluators, spans, strict=True):
            ends = (span.low, span.high) if span else (None, None)
            rows.append(
                [
                    Text(text=section.title, link=f"#/{section.key}"),
                    side.label,
                    first.name if first and span else "-",
                    Number(
                        value=span.value if span else None,
                        ends=None if ends[0] is None or ends[1] is None else (ends[0], ends[1]),
                        digits=3,
                        below=span.over if span else "",
                    ),
                    Count(n=side.scored, of=section.attempted or 0),
                    f"{evaluator.name} {evaluator.version}",
                ]
            )
    header = ("task", "side", "metric", "value", "scored", "evaluator")
    notes = ("Numbers of different tasks are over their own denominators: they do not add up.",)
    return table(header, rows, title="All tasks", notes=notes)


def without_specialist(shown: Table) -> Table:
    """The table with a column that says that no specialist was run."""
    rows = ((*row, Text(text=NO_SPECIALIST if k == 0 else "")) for k, row in enumerate(shown.rows))
    columns = (*shown.columns, Column(name="specialist"))
    return replace(shown, columns=columns, rows=tuple(rows))


def coverage_table(sides: Sequence[StoredEvaluation]) -> Table:
    """Attempted, scored, with truth, and every status, a side a column."""
    coverages = [side.summary.coverage for side in sides]
    names = ["attempted", "scored", "valid", "with_truth", "scored_with_truth"]
    names += ["scored_without_predictions"]
    rows: list[list[Cell]] = [
        [name.replace("_", " "), *(getattr(c, name, "-") for c in coverages)]
        for name in names
        if any(hasattr(c, name) for c in coverages)
    ]
    rows += [
        [f"status {status}", *(c.by_status.get(status, 0) for c in coverages)]
        for status in sorted({s for c in coverages for s in c.by_status})
    ]
    return table(["images", *(side.name for side in sides)], rows, title="Coverage")


def category_lines(sides: Sequence[StoredEvaluation]) -> list[CategoryLine]:
    """A line of each category that has truth or predictions on any side, ascending id."""
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


def category_table(
    section: str, sides: Sequence[StoredEvaluation], lines: Sequence[CategoryLine]
) -> Table:
    """The categories as a page's scripts sort and filter them; names lead to their photos."""
    frequencies = any(line.frequency for line in lines)
    first = ("category", "name"), *[("freq.", "freq")] * frequencies
    columns = [*first, ("objects", "truth"), ("images", "images")]
    of_side = ("AP", "ap"), ("AP50", "ap50"), ("mIoU", "miou"), ("predictions", "n")
    return Table(
        columns=(
            *(Column(name=name, key=key) for name, key in columns),
            *(
                Column(name=name, key=f"{key}{k}", group=side.name)
                for k, side in enumerate(sides)
                for name, key in (*of_side, ("TP", "tp"), ("FP", "fp"))
            ),
        ),
        rows=tuple(
            (
                Text(text=line.name, link=f"#/{section}?tab=photos&cat={line.id}"),
                *[line.frequency or "-"] * frequencies,
                line.n_truth,
                line.n_images,
                *(cell for found in line.cells for cell in _numbers(found, line.n_truth)),
            )
            for line in lines
        ),
        notes=(
            "AP over IoU 0.50 to 0.95; TP and FP at IoU 0.5; mIoU: the best one-to-one overlap of "
            "every annotated object, 0 where there is none. A category without ground truth has "
            "no AP, and its false positives cost none.",
        ),
        key="categories",
    )


def _numbers(found: CategoryCell | None, n_truth: int) -> Iterator[Cell]:
    if found is None:
        yield from ("-", "-", "-", 0, 0, 0)
        return
    yield from (Number(value=v, digits=3) for v in (found.ap, found.ap50, found.miou))
    yield from (found.n, Count(n=found.tp, of=n_truth), found.fp)


def comparison_tables(comparison: Comparison) -> list[ComparedPair]:
    """Each pair of a comparison with its tables, the headline first and the others folded."""
    return [
        ComparedPair(
            scene=pair.scene,
            baseline=pair.baseline,
            coverage=pair.coverage,
            dropped=pair.dropped,
            tables=tuple(
                _difference_cell(pair, rows, f"{len(rows)} {title}" if title else "")
                for level, title in _LEVELS.items()
                if (rows := [row for row in pair.rows if row.level == level])
            ),
        )
        for pair in comparison.pairs
    ]


def _difference_cell(pair: Pair, rows: Sequence[ComparisonRow], title: str) -> Table:
    return table(
        ["metric", "images", "policy", "difference", pair.scene, pair.baseline],
        [
            [
                row.metric.removeprefix(f"{row.policy}.").removesuffix(f".{row.policy}"),
                row.images,
                Text(text=row.policy.replace("_", " "), below=f"{row.better} is better"),
                number(row.difference, signed=True),
                *(replace(number(side), below=_over(side)) for side in (row.scene, row.baseline)),
            ]
            for row in rows
        ],
        title=title,
        folded=bool(title),
    )


def _over(side: Measured) -> str:
    constant = f"; a constant: {side.constant:.4f}" if isinstance(side.constant, float) else ""
    return over_text(side) + constant
