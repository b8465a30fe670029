"""The output of `legoworld compare`: verdicts and headline metrics, or every table with -v."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from legoworld.comparison.tables import (
    coverage_table,
    headline_blocks,
    list_comparisons,
    list_notes,
    number,
    shorten_name,
)
from legoworld.comparison.verdict import classify_difference, headline_rows, verdict_sentences
from legoworld.pluralize import plural
from legoworld.tables.table import Cell, Table, table
from legoworld.tables.terminal import WIDTH, terminal, wrap_parts

if TYPE_CHECKING:
    from legoworld.comparison.tables import Document
    from legoworld.records.comparison import ComparisonRow, Pair


def short_comparison(document: Document) -> str:
    """The verdict of every pair, its coverage, and its headline metrics with their differences."""
    pairs = [(one.task, pair) for one in list_comparisons(document) for pair in one.pairs]
    verdicts = [said for task, pair in pairs for said, _ in verdict_sentences(task, pair)]
    count = plural(len(list_notes(document)), "note", "notes")
    ends = [f"{start}{reasons}" for start, reasons in _not_paired(document)]
    ends.append(f"{count} on interpretation, and all tables: -v")
    blocks = (terminal(_headline(task, pair)) for task, pair in pairs)
    return "\n\n".join([_notes(verdicts), *blocks, _notes(ends)])


def whole_comparison(document: Document) -> str:
    """Every table, at most 100 columns wide: intervals and denominators below their numbers."""
    coverage = coverage_table(document)
    rows = [[*row[:3], shorten_name(str(row[3])), row[4], shorten_name(str(row[5])), *row[6:-1]]
            for row in coverage.rows]  # fmt: skip
    reasons = [text for pair in _not_paired(document) for text in wrap_parts(*pair)]
    return "\n\n".join(
        [
            *(terminal(block, stacked=True) for block in headline_blocks(document)),
            "\n".join([terminal(table(coverage.header[:-1], rows)), *reasons]),
            _notes(list_notes(document)),
        ]
    )


def _headline(task: str, pair: Pair) -> Table:
    coverage = pair.coverage
    title = (
        f"{task}: {pair.scene} against {pair.baseline}, "
        f"{coverage.paired} paired of {coverage.attempted} attempted images"
    )
    rows: list[list[Cell]] = [
        [row.metric, number(row.scene, digits=3), number(row.baseline, digits=3),
         number(row.difference, signed=True, digits=3), _word(row)]
        for row in headline_rows(pair)
    ]  # fmt: skip
    return table(["metric", "scene", "against", "difference", ""], rows, title=title)


def _word(row: ComparisonRow) -> str:
    """The side that the interval of the difference favours, in a word that fits the table."""
    verdict = classify_difference(row)
    return "undecided" if verdict == "not told apart" else verdict


def _not_paired(document: Document) -> list[tuple[str, str]]:
    """For each pair that lacks images: which it is, and the reasons with their counts."""
    return [
        (f"not paired in {row[0]}, {row[3]} and {row[5]}: ", str(row[-1]))
        for row in coverage_table(document).rows
        if row[-1] != "-"
    ]


def _notes(notes: Sequence[str]) -> str:
    return "\n".join(textwrap.fill(note, WIDTH, break_on_hyphens=False) for note in notes)
