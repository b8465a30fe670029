"""What `legoworld compare` prints without -v: a verdict for each headline metric, and coverage."""

from __future__ import annotations

from typing import Any

from legoworld.commands import options
from legoworld.commands.comparison_text import notes_text
from legoworld.comparison.measures import HEADLINE
from legoworld.comparison.tables import comparisons_of, coverage_table, headline_table
from legoworld.wording import counted

Document = dict[str, Any]


def short_comparison(document: Document) -> str:
    """Two methods, their coverage, and the headline metrics with the verdict on the difference."""
    blocks = [
        f"{_title(one['task'], pair)}\n{_table(pair)}"
        for one in comparisons_of(document)
        for pair in one["pairs"]
    ]
    notes = [
        f"not paired in {row[0]}, {row[3]} and {row[5]}: {row[-1]}"
        for row in coverage_table(document).rows
        if row[-1] != "-"
    ]
    count = counted(len(headline_table(document).notes), "note", "notes")
    notes.append(f"{count} on how to read this, and all tables: -v")
    return "\n\n".join([*blocks, notes_text(notes)])


def _title(task: str, pair: Document) -> str:
    coverage = pair["coverage"]
    return (
        f"{task}: {pair['scene']} against {pair['baseline']}, "
        f"{coverage['paired']} paired of {coverage['attempted']} attempted images"
    )


def _table(pair: Document) -> str:
    rows = [
        [row["metric"], _number(row["scene"]), _number(row["baseline"]),
         _number(row["difference"], signed=True), _word(row)]
        for row in _headline(pair)
    ]  # fmt: skip
    return options.table(["metric", "scene", "against", "difference", ""], rows)


def _headline(pair: Document) -> list[Document]:
    """The first metrics over the paired images; over all attempted ones where none is paired."""
    rows = [row for row in pair["rows"] if row["level"] <= HEADLINE]
    paired = [row for row in rows if row["images"] == "paired"]
    return paired or [row for row in rows if row["images"] == "attempted"]


def _word(row: Document) -> str:
    """Which side the interval of the difference is on."""
    value, interval = row["difference"]["value"], row["difference"]["interval"]
    if value is None or interval is None or interval["low"] is None:
        return "no interval"
    if interval["low"] <= 0 <= interval["high"]:
        return "undecided"
    higher_is_better = row["better"] == "higher"
    return "better" if (interval["low"] > 0) == higher_is_better else "worse"


def _number(side: Document, *, signed: bool = False) -> str:
    value, interval = side["value"], side["interval"]
    if value is None:
        return "undefined"
    text = f"{value + 0.0:{'+' if signed else ''}.3f}"
    if interval is None or interval["low"] is None:
        return text
    return f"{text} [{interval['low']:.3f}, {interval['high']:.3f}]"
