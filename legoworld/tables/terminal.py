"""A table as text for a terminal, at most 100 columns wide as far as wrapping can do that."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import zip_longest
from typing import Final

from legoworld.errors import name_on_line
from legoworld.tables.table import Cell, Number, Table, Text, line

WIDTH: Final = 100
_NARROWEST: Final = 16

#: The lines of each cell of a row.
Lines = list[list[str]]


def terminal(table: Table, *, stacked: bool = False) -> str:
    """Columns as narrow as possible, those of numbers right-aligned, the widest one wrapped.

    stacked: an interval stands below its number, and what a cell has below it under that.
    """
    header = [name_on_line(name) for name in table.header]
    rows = [[_lines(cell, stacked=stacked) for cell in row] for row in table.rows]
    if stacked:
        room = WIDTH - sum(_widths(header, rows)[1:]) - 2 * (len(header) - 1)
        for row, (first, *_) in zip(rows, table.rows, strict=True):
            if isinstance(first, Text) and first.below:
                row[0] += wrap_parts("  ", name_on_line(first.below), width=room)
    rows = _narrow_rows(header, rows)
    widths = _widths(header, rows)

    def text(cells: Sequence[str]) -> str:
        parts = (
            c.rjust(w) if n else c.ljust(w)
            for c, w, n in zip(cells, widths, table.numeric, strict=True)
        )
        return "  ".join(parts).rstrip()

    lines = (text(cells) for row in rows for cells in zip_longest(*row, fillvalue=""))
    title = textwrap.wrap(name_on_line(table.title), WIDTH)
    return "\n".join([*title, text(header), "  ".join("-" * w for w in widths), *lines])


def _lines(cell: Cell, *, stacked: bool) -> list[str]:
    if stacked and isinstance(cell, Number):
        return [str(cell), *filter(None, [cell.interval_text])]
    return [name_on_line(line(cell))]


def _widths(header: Sequence[str], rows: Sequence[Lines]) -> list[int]:
    return [
        max([len(name), *(len(part) for row in rows for part in row[k])])
        for k, name in enumerate(header)
    ]


def _narrow_rows(header: Sequence[str], rows: Sequence[Lines]) -> list[Lines]:
    """The rows with their widest column broken into more lines where the table is too wide."""
    widths = _widths(header, rows)
    beyond = sum(widths) + 2 * (len(widths) - 1) - WIDTH
    widest = max(range(len(widths)), key=widths.__getitem__, default=0)
    if beyond <= 0 or widths[widest] - beyond < max(_NARROWEST, len(header[widest])):
        return [*rows]
    return [
        [
            [
                part
                for text in cell
                for part in textwrap.wrap(text, widths[widest] - beyond, break_on_hyphens=False)
            ]
            if k == widest
            else cell
            for k, cell in enumerate(row)
        ]
        for row in rows
    ]


def wrap_parts(start: str, text: str, *, width: int = WIDTH) -> list[str]:
    """Comma-separated parts, filled into lines; a part too long for a line is wrapped by word."""
    lines = [start]
    *parts, last = text.split(", ")
    for part in (*(f"{part}, " for part in parts), last):
        if len(lines[-1] + part.rstrip()) > width and lines[-1].strip():
            lines.append("  ")
        lines[-1] += part
    whole = (textwrap.wrap(text, width, subsequent_indent="  ") for text in lines)
    return [text for part in whole for text in part]


def within_width(text: str) -> str:
    """Lines that are wider than a table may be, wrapped."""
    return "\n".join(
        textwrap.fill(line, WIDTH, subsequent_indent="  ", break_on_hyphens=False)
        if len(line) > WIDTH
        else line
        for line in text.split("\n")
    )
