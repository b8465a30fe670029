"""The output of `legoworld compare` without -v: a verdict per headline metric, and coverage."""

from __future__ import annotations

from typing import TYPE_CHECKING

from legoworld.commands import options
from legoworld.commands.comparison_text import notes_text
from legoworld.comparison.tables import comparisons_of, coverage_table, headline_table
from legoworld.comparison.verdict import headline_rows, standing, verdict_sentence
from legoworld.pluralize import counted

if TYPE_CHECKING:
    from legoworld.comparison.tables import Document
    from legoworld.records.comparison import ComparisonRow, Difference, Pair


def short_comparison(document: Document) -> str:
    """The verdict of every pair, its coverage, and its headline metrics with their differences."""
    verdicts = [
        f"{verdict_sentence(one.task, pair)}."
        for one in comparisons_of(document)
        for pair in one.pairs
    ]
    blocks = [
        f"{_title(one.task, pair)}\n{_table(pair)}"
        for one in comparisons_of(document)
        for pair in one.pairs
    ]
    notes = [
        f"not paired in {row[0]}, {row[3]} and {row[5]}: {row[-1]}"
        for row in coverage_table(document).rows
        if row[-1] != "-"
    ]
    count = counted(len(headline_table(document).notes), "note", "notes")
    notes.append(f"{count} on interpretation, and all tables: -v")
    return "\n\n".join([notes_text(verdicts), *blocks, notes_text(notes)])


def _title(task: str, pair: Pair) -> str:
    coverage = pair.coverage
    return (
        f"{task}: {pair.scene} against {pair.baseline}, "
        f"{coverage.paired} paired of {coverage.attempted} attempted images"
    )


def _table(pair: Pair) -> str:
    rows = [
        [row.metric, _number(row.scene), _number(row.baseline),
         _number(row.difference, signed=True), _word(row)]
        for row in headline_rows(pair)
    ]  # fmt: skip
    return options.table(["metric", "scene", "against", "difference", ""], rows)


def _word(row: ComparisonRow) -> str:
    """The side that the interval of the difference favours, in a word that fits the table."""
    verdict = standing(row)
    return "undecided" if verdict == "not told apart" else verdict


def _number(side: Difference, *, signed: bool = False) -> str:
    if side.value is None:
        return "undefined"
    text = f"{side.value + 0.0:{'+' if signed else ''}.3f}"
    return "{} [{:.3f}, {:.3f}]".format(text, *side.ends) if side.ends else text
