"""The two tables of a comparison: metric by method, and coverage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from typing import Final

from legoworld.comparison.measures import HEADLINE, TABLE
from legoworld.records.comparison import (
    Comparison,
    ComparisonRow,
    Difference,
    JoinedComparison,
    Measured,
    Pair,
)
from legoworld.tables.table import Cell, Number, Table, Text, table

Document = Comparison | JoinedComparison

#: Names of denominators in tables, largest first; a row shows the ones it has.
_OVER: Final = {
    "images": ("image", "images"),
    "missing": ("missing as 1.0", "missing as 1.0"),
    "not valid": ("not valid as 0", "not valid as 0"),
    "categories": ("category", "categories"),
    "truths": ("truth", "truths"),
    "predictions": ("prediction", "predictions"),
    "pairs": ("pair", "pairs"),
}
#: A column of the CSV only where a row has it: the other tasks' CSVs are older than it.
_OF_BENCH: Final = "not valid"
_SIDES: Final = ("scene", "baseline", "difference")
_CSV_SIDE: Final = ("value", "low", "high")
_NAME_WIDTH: Final = 18


def list_comparisons(document: Document) -> tuple[Comparison, ...]:
    """The comparisons in a document: itself, or the joined ones."""
    return (document,) if isinstance(document, Comparison) else document.comparisons


def number(side: Difference, *, signed: bool = False, digits: int = 4) -> Number:
    """A side's value with its interval; an expected AP has its spread over tie orders instead."""
    sd = side.sd if isinstance(side, Measured) and isinstance(side.sd, float) else None
    return Number(value=side.value, ends=side.ends, sd=sd, signed=signed, digits=digits)


def over_text(side: Measured) -> str:
    """One side's denominators, images first."""
    counts = sorted(side.over.items(), key=lambda count: (count[0] != "images", count[0]))
    return ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counts)


def headline_table(document: Document) -> Table:
    """Metric by method: values and intervals with denominators, and the difference.

    Of joined comparisons the first metrics of each task; of one, all but the details. Two methods
    alone have a column each; more are rows.
    """
    pairs = _pairs(document)
    named = {(pair.scene, pair.baseline) for _, pair in pairs}
    rows: list[list[Cell]] = []
    for task, pair in pairs:
        for row in _displayed_rows(document, pair):
            cells: list[Cell] = [number(row.scene), number(row.baseline)]
            if len(named) > 1:
                cells = [pair.scene, cells[0], pair.baseline, cells[1]]
            over = ", ".join(_denominators(row))
            rows.append([task, _name(row), *cells, number(row.difference, signed=True), over])
    methods = [*named.pop()] if len(named) == 1 else ["method", "value", "against", "its value"]
    return table(
        ["task", "metric", *methods, "difference", "over"], rows, notes=list_notes(document)
    )


def headline_blocks(document: Document) -> list[Table]:
    """The same in a table for each task, pair of methods and set of images."""
    blocks = []
    for task, pair in _pairs(document):
        for _, alike in groupby(
            _displayed_rows(document, pair), key=lambda row: _denominators(row)[0]
        ):
            of_images = list(alike)
            images = _denominators(of_images[0])[0]
            rows: list[list[Cell]] = [
                [
                    Text(text=_name(row), below=", ".join(_denominators(row)[1:])),
                    number(row.scene),
                    number(row.baseline),
                    number(row.difference, signed=True),
                ]
                for row in of_images
            ]
            title = f"{task}, {images}: {pair.scene} and {pair.baseline}"
            header = ["metric", shorten_name(pair.scene), shorten_name(pair.baseline), "difference"]
            blocks.append(table(header, rows, title=title))
    return blocks


def shorten_name(name: str) -> str:
    """A method's name, at most as wide as the interval of a difference."""
    return name if len(name) <= _NAME_WIDTH else name[: _NAME_WIDTH - 1] + "…"


def _pairs(document: Document) -> list[tuple[str, Pair]]:
    return [(one.task, pair) for one in list_comparisons(document) for pair in one.pairs]


def _displayed_rows(document: Document, pair: Pair) -> list[ComparisonRow]:
    level = TABLE if isinstance(document, Comparison) else HEADLINE
    return [row for row in pair.rows if row.level <= level]


def coverage_table(document: Document) -> Table:
    """Attempted, scored and paired, one row per pair, with the reasons for dropped images."""
    rows: list[list[Cell]] = []
    for task, pair in _pairs(document):
        coverage = pair.coverage
        dropped = Counter(reason for d in pair.dropped for reason in d.reasons)
        reasons = ", ".join(f"{reason} ({n})" for reason, n in sorted(dropped.items()))
        rows.append(
            [
                task,
                coverage.attempted,
                coverage.with_truth,
                pair.scene,
                coverage.scene_scored,
                pair.baseline,
                coverage.baseline_scored,
                coverage.paired,
                reasons or "-",
            ]
        )
    header = ["task", "attempted", "with truth", "method", "scored", "against", "its scored"]
    return table([*header, "paired", "not paired"], rows)


def csv_table(document: Document) -> Table:
    """Every row of every comparison, unrounded; an undefined number is an empty cell."""
    of_bench = any(
        _OF_BENCH in row.scene.over
        for one in list_comparisons(document)
        for pair in one.pairs
        for row in pair.rows
    )
    over = [name for name in _OVER if of_bench or name != _OF_BENCH]
    header = ["task", "metric", "policy", "images", "better", "level", "method", "against"]
    for side in _SIDES:
        header += [f"{side}_{name}" for name in _CSV_SIDE]
        if side != "difference":
            header += [f"{side}_over_{name.replace(' ', '_')}" for name in over]
    header += ["interval_level", "interval_unit", "draws"]
    rows: list[list[Cell]] = []
    for one in list_comparisons(document):
        for pair in one.pairs:
            for row in pair.rows:
                cells: list[Cell] = [one.task, *(getattr(row, k) for k in header[1:6])]
                cells += [pair.scene, pair.baseline]
                for side in _SIDES:
                    cells += _csv_side(getattr(row, side), over)
                drawn = one.bootstrap
                rows.append([*cells, Number(value=drawn.level), drawn.unit, drawn.draws])
    return table(header, rows)


def _csv_side(side: Difference, over: Sequence[str]) -> list[Cell]:
    low, high = (side.interval.low, side.interval.high) if side.interval else (None, None)
    cells: list[Cell] = [Number(value=n) for n in (side.value, low, high)]
    if not isinstance(side, Measured):
        return cells
    return cells + [side.over.get(name, "") for name in over]


def _name(row: ComparisonRow) -> str:
    """A metric with the better direction."""
    return f"{row.metric} {'↑' if row.better == 'higher' else '↓'}"


def _denominators(row: ComparisonRow) -> list[str]:
    """The denominators of a row, images first; both methods' where they differ."""
    ours, theirs = row.scene.over, row.baseline.over
    parts: list[str] = []
    for name, words in _OVER.items():
        if name in ours:
            counts = [ours[name]] if ours[name] == theirs[name] else [ours[name], theirs[name]]
            word = words[0] if counts == [1] else words[1]
            which = f"{row.images} " if name == "images" else ""
            parts.append(f"{' / '.join(map(str, counts))} {which}{word}")
    return parts


def list_notes(document: Document) -> list[str]:
    """What the numbers were drawn and computed by, and the comparison's own notes."""
    notes = []
    for one in list_comparisons(document):
        drawn, evaluator = one.bootstrap, one.evaluator
        notes.append(
            f"{one.task}: {evaluator.name} {evaluator.version}; "
            f"{drawn.level:.0%} intervals from {drawn.draws} bootstrap samples over "
            f"{drawn.unit}s, shared by both methods, seed {drawn.seed}."
        )
        if one is not document:
            notes += [f"{one.task}: {note}" for note in one.notes]
    return [*notes, *document.notes]
