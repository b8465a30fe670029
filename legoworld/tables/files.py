"""A table as Markdown, LaTeX or CSV; names come from strangers and stay text in each."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from typing import Final

from legoworld.escaping import csv_cell, latex_cell, markdown_cell
from legoworld.tables.table import Cell, Number, Table, line


def markdown(table: Table) -> str:
    """A GitHub table, its notes as a list."""
    lines = [table.header, ["---"] * len(table.columns), *(map(line, row) for row in table.rows)]
    text = "".join(f"| {' | '.join(map(markdown_cell, cells))} |\n" for cells in lines)
    notes = "".join(f"- {markdown_cell(note)}\n" for note in table.notes)
    return text + ("\n" + notes if notes else "")


def latex(table: Table) -> str:
    """A booktabs tabular, its notes as comments."""
    lines = [
        " & ".join(latex_cell(line(cell)) for cell in cells) + r" \\"
        for cells in (table.header, *table.rows)
    ]
    whole = [
        r"% needs \usepackage{booktabs}",
        *(f"% {' '.join(note.split())}" for note in table.notes),
        rf"\begin{{tabular}}{{{'l' * len(table.columns)}}}",
        r"\toprule",
        lines[0],
        r"\midrule",
        *lines[1:],
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(whole) + "\n"


def comma_separated(table: Table) -> str:
    """CSV with a header: numbers unrounded, undefined ones empty, without notes.

    Intervals are written only where the table has columns for them.
    """
    stream = io.StringIO()
    rows = [
        [csv_cell(_full_precision(cell)) for cell in row] for row in (table.header, *table.rows)
    ]
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def _full_precision(cell: Cell) -> str:
    if not isinstance(cell, Number):
        return str(cell)
    return "" if cell.value is None else repr(cell.value)


FORMATS: Final[dict[str, Callable[[Table], str]]] = {
    "md": markdown,
    "tex": latex,
    "csv": comma_separated,
}
