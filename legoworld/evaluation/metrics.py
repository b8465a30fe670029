"""An evaluation's tables and the words for its numbers: each with its interval and denominators."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from legoworld.pluralize import plural, share
from legoworld.records.evaluation import Coverage, Interval, Summary
from legoworld.tables.table import Cell, Column, Number, Spread, Table

#: Maximum number of lines of one kind.
_SHORT: Final = 3


@dataclass(frozen=True, kw_only=True)
class MetricRow:
    """One number of an evaluation.

    over: its denominators; policy: where a metric has several; constant: what an answer that is
    the same everywhere scores.
    """

    name: str
    number: Number
    over: str
    policy: str = ""
    constant: Number | None = None

    @property
    def id(self) -> str:
        """The metric as comparisons call it."""
        return f"{self.name}.{self.policy}" if self.policy else self.name


@dataclass(frozen=True, kw_only=True)
class MetricPart:
    """Numbers that stand in one table. note: how to read them."""

    title: str
    rows: Sequence[MetricRow]
    note: str = ""


def number_cell(value: float | None, interval: Interval | None = None) -> Number:
    """A number of a summary with its interval."""
    return Number(value=value, ends=interval.ends if interval and value is not None else None)


def metric_parts(summary: Summary) -> list[MetricPart]:
    """The metrics that every summary names, over its images."""
    coverage = summary.coverage
    over = share(coverage.scored, coverage.attempted, "image", "images")
    rows = [
        MetricRow(name=name, policy=policy or "", number=number_cell(value, interval), over=over)
        for name, policy, value, interval in summary.metric_values()
    ]
    return [MetricPart(title="Every metric", rows=rows)]


def metric_tables(sides: Sequence[tuple[str, Sequence[MetricPart]]]) -> list[Table]:
    """A table for each part, three or four columns for each side; a page folds all but the first.

    sides: a name, which one side may lack, and its parts.
    """
    parts = {part.title: part.note for _, side in sides for part in side}
    return [
        _table(
            [(name, [row for p in side if p.title == title for row in p.rows])
             for name, side in sides],
            title=title, note=note, folded=k > 0,
        )
        for k, (title, note) in enumerate(parts.items())
    ]  # fmt: skip


def _table(
    sides: Sequence[tuple[str, Sequence[MetricRow]]], *, title: str, note: str, folded: bool
) -> Table:
    found: dict[tuple[str, str], dict[int, MetricRow]] = {}
    for k, (_, rows) in enumerate(sides):
        for row in rows:
            found.setdefault((row.name, row.policy), {})[k] = row
    policies = any(policy for _, policy in found)
    constants = any(row.constant for _, rows in found.items() for row in rows.values())
    names = ["value", "95 % interval", *["constant"] * constants, "over"]
    columns = [Column(name=name) for name in ("metric", *["policy"] * policies)]
    columns += [Column(name=name, group=side) for side, _ in sides for name in names]
    return Table(
        columns=tuple(columns),
        rows=tuple(
            (name, *[policy] * policies,
             *(c for k in range(len(sides)) for c in _cells(rows.get(k), constants=constants)))
            for (name, policy), rows in found.items()
        ),
        title=title,
        notes=(note,) if note else (),
        folded=folded,
    )  # fmt: skip


def _cells(row: MetricRow | None, *, constants: bool) -> Iterator[Cell]:
    if row is None:
        yield from ("-", "-", *["-"] * constants, "")
        return
    yield row.number.without_interval
    yield Spread(of=row.number)
    if constants:
        yield row.constant or "-"
    yield row.over


def describe_evaluator(summary: Summary) -> str:
    """The evaluator and its version."""
    return f"{summary.evaluator.name} {summary.evaluator.version}"


def image_counts(coverage: Coverage) -> str:
    """Images attempted, scored and with truth."""
    return (
        f"{plural(coverage.attempted, 'image', 'images')} attempted, {coverage.scored} "
        f"scored, {coverage.with_truth} with truth"
    )


def fraction(value: float | None) -> str:
    """A number with four digits, "-" where it is undefined."""
    return str(Number(value=value))


def bounds(interval: Interval | None) -> str:
    """An interval after a space, "" without one."""
    ends = interval.ends if interval else None
    return f" {Number(value=None, ends=ends).interval_text}" if ends else ""


def first_few(lines: Sequence[str], one: str, many: str) -> list[str]:
    """The first lines of one kind, and how many more there are."""
    if len(lines) <= _SHORT:
        return [*lines]
    more = plural(len(lines) - _SHORT, f"more {one}", f"more {many}")
    return [*lines[:_SHORT], f"... and {more} (-v lists all)"]
