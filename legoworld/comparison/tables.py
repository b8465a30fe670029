"""The two tables of a comparison: metric by method, and coverage."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from legoworld.comparison.formats import Table
from legoworld.comparison.measures import HEADLINE, TABLE
from legoworld.records.comparison import (
    Comparison,
    ComparisonRow,
    Difference,
    JoinedComparison,
    Measured,
)

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


def comparisons_of(document: Document) -> tuple[Comparison, ...]:
    """The comparisons in a document: itself, or the joined ones."""
    return (document,) if isinstance(document, Comparison) else document.comparisons


def headline_table(document: Document) -> Table:
    """Metric by method: values and intervals with denominators, and the difference.

    Of joined comparisons the first metrics of each task; of one, all but the details. Two methods
    alone have a column each; more are rows.
    """
    level = TABLE if isinstance(document, Comparison) else HEADLINE
    pairs = [(one.task, pair) for one in comparisons_of(document) for pair in one.pairs]
    named = {(pair.scene, pair.baseline) for _, pair in pairs}
    rows = []
    for task, pair in pairs:
        for row in pair.rows:
            if row.level <= level:
                cells = [_cell(row.scene), _cell(row.baseline)]
                if len(named) > 1:
                    cells = [pair.scene, cells[0], pair.baseline, cells[1]]
                difference = _cell(row.difference, signed=True)
                rows.append([task, _name(row), *cells, difference, _denominators(row)])
    methods = [*named.pop()] if len(named) == 1 else ["method", "value", "against", "its value"]
    header = ["task", "metric", *methods, "difference", "over"]
    return Table(header=header, rows=rows, notes=_notes(document))


def coverage_table(document: Document) -> Table:
    """Attempted, scored and paired, one row per pair, with the reasons for dropped images."""
    rows = []
    for one in comparisons_of(document):
        for pair in one.pairs:
            coverage = pair.coverage
            dropped = Counter(reason for d in pair.dropped for reason in d.reasons)
            rows.append(
                [
                    one.task,
                    str(coverage.attempted),
                    str(coverage.with_truth),
                    pair.scene,
                    str(coverage.scene_scored),
                    pair.baseline,
                    str(coverage.baseline_scored),
                    str(coverage.paired),
                    ", ".join(f"{reason} ({n})" for reason, n in sorted(dropped.items())) or "-",
                ]
            )
    header = ["task", "attempted", "with truth", "method", "scored", "against", "its scored"]
    return Table(header=[*header, "paired", "not paired"], rows=rows)


def csv_table(document: Document) -> Table:
    """Every row of every comparison, unrounded; an undefined number is an empty cell."""
    of_bench = any(
        _OF_BENCH in row.scene.over
        for one in comparisons_of(document)
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
    rows = []
    for one in comparisons_of(document):
        for pair in one.pairs:
            for row in pair.rows:
                cells = [one.task, *(str(getattr(row, k)) for k in header[1:6])]
                cells += [pair.scene, pair.baseline]
                for side in _SIDES:
                    cells += _csv_side(getattr(row, side), over)
                cells += [str(getattr(one.bootstrap, k)) for k in ("level", "unit", "draws")]
                rows.append(cells)
    return Table(header=header, rows=rows)


def _csv_side(side: Difference, over: Sequence[str]) -> list[str]:
    low, high = (side.interval.low, side.interval.high) if side.interval else (None, None)
    cells = ["" if n is None else repr(n) for n in (side.value, low, high)]
    if not isinstance(side, Measured):
        return cells
    return cells + [str(side.over.get(name, "")) for name in over]


def _cell(side: Difference, *, signed: bool = False) -> str:
    """Value and interval; an expected AP shows the spread over tie orders instead."""
    form = "+.4f" if signed else ".4f"
    if side.value is None:
        return "-"
    value = side.value + 0.0  # -0.0 prints as +0.0000
    if side.ends:
        low, high = (end + 0.0 for end in side.ends)
        return f"{value:{form}} [{low:{form}}, {high:{form}}]"
    if isinstance(side, Measured) and isinstance(side.sd, float):
        return f"{value:{form}} (sd {side.sd:.4f})"
    return f"{value:{form}}"


def _name(row: ComparisonRow) -> str:
    """A metric with the better direction."""
    return f"{row.metric} {'↑' if row.better == 'higher' else '↓'}"


def _denominators(row: ComparisonRow) -> str:
    """The denominators of a row; if the two methods differ, both, the scene's first."""
    ours, theirs = row.scene.over, row.baseline.over
    parts: list[str] = []
    for name, words in _OVER.items():
        if name in ours:
            counts = [ours[name]] if ours[name] == theirs[name] else [ours[name], theirs[name]]
            word = words[0] if counts == [1] else words[1]
            which = f"{row.images} " if name == "images" else ""
            parts.append(f"{' / '.join(map(str, counts))} {which}{word}")
    return ", ".join(parts)


def _notes(document: Document) -> list[str]:
    notes = []
    for one in comparisons_of(document):
        drawn, evaluator = one.bootstrap, one.evaluator
        notes.append(
            f"{one.task}: {evaluator.name} {evaluator.version}; "
            f"{drawn.level:.0%} intervals from {drawn.draws} bootstrap samples over "
            f"{drawn.unit}s, shared by both methods, seed {drawn.seed}."
        )
        if one is not document:
            notes += [f"{one.task}: {note}" for note in one.notes]
    return [*notes, *document.notes]
