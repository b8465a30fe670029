"""A comparison's two tables for a terminal: complete, at most 100 columns wide."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import groupby, zip_longest
from typing import TYPE_CHECKING, Final

from legoworld.commands import options

if TYPE_CHECKING:
    from legoworld.comparison.formats import Table

_WIDTH: Final = 100
_NAME_WIDTH: Final = 18  # as wide as the interval of a difference


def headline_text(table: Table) -> str:
    """Metric by method, in one block per task, pair of methods and set of images.

    The interval is below its value; below a metric is its denominator besides the images.
    """
    rows = [_Row(table.header, cells) for cells in table.rows]
    return "\n\n".join(_block(list(rows)) for _, rows in groupby(rows, key=lambda row: row.title))


def coverage_text(table: Table) -> str:
    """The coverage table, followed by the reasons why images were not paired."""
    rows = [[*row[:3], _cut(row[3]), row[4], _cut(row[5]), *row[6:-1]] for row in table.rows]
    lines = [options.table(table.header[:-1], rows)]
    for row in table.rows:
        if row[-1] != "-":
            lines += _wrapped(f"not paired in {row[0]}, {row[3]} and {row[5]}: ", row[-1])
    return "\n".join(lines)


def notes_text(notes: Sequence[str]) -> str:
    """Sentences, wrapped."""
    return "\n".join(textwrap.fill(note, _WIDTH, break_on_hyphens=False) for note in notes)


class _Row:
    """One row of the headline table: two methods get a column each, further ones are named."""

    def __init__(self, header: Sequence[str], cells: Sequence[str]) -> None:
        task, self.metric, *middle, self.difference, over = cells
        if len(middle) == 2:
            self.methods, self.values = (header[2], header[3]), (middle[0], middle[1])
        else:
            self.methods, self.values = (middle[0], middle[2]), (middle[1], middle[3])
        images, _, self.denominators = over.partition(", ")
        self.title = f"{task}, {images}: {self.methods[0]} and {self.methods[1]}"


def _block(rows: Sequence[_Row]) -> str:
    numbers = [[cell.split(" ", 1) for cell in (*row.values, row.difference)] for row in rows]
    header = [_cut(name) for name in rows[0].methods] + ["difference"]
    widths = [
        max(len(name), *(len(part) for row in numbers for part in row[i]))
        for i, name in enumerate(header)
    ]
    left = _WIDTH - sum(widths) - 2 * len(widths)
    lines: list[tuple[str, ...]] = []
    for row, cells in zip(rows, numbers, strict=True):
        over = _wrapped("  ", row.denominators, width=left) if row.denominators else []
        lines += zip_longest([row.metric, *over], *cells, fillvalue="")
    title = "\n".join(textwrap.wrap(rows[0].title, _WIDTH))
    return f"{title}\n{options.table(['metric', *header], lines)}"


def _cut(name: str) -> str:
    return name if len(name) <= _NAME_WIDTH else name[: _NAME_WIDTH - 1] + "…"


def _wrapped(start: str, text: str, *, width: int = _WIDTH) -> list[str]:
    """Comma-separated parts, filled into lines; a part too long for a line is wrapped by word."""
    lines = [start]
    *parts, last = text.split(", ")
    for part in (*(f"{part}, " for part in parts), last):
        if len(lines[-1] + part.rstrip()) > width and lines[-1].strip():
            lines.append("  ")
        lines[-1] += part
    whole = (textwrap.wrap(line, width, subsequent_indent="  ") for line in lines)
    return [line for part in whole for line in part]
