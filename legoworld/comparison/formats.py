"""A table as Markdown, LaTeX or CSV; the same cells in each."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from legoworld.escaping import csv_cell, latex_cell, markdown_cell


@dataclass(frozen=True, kw_only=True)
class Table:
    """Text cells under their header. notes: sentences below it."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()


def markdown(table: Table) -> str:
    """A GitHub table, its notes as a list."""
    lines = [table.header, ["---"] * len(table.header), *table.rows]
    text = "".join(f"| {' | '.join(map(markdown_cell, line))} |\n" for line in lines)
    notes = "".join(f"- {markdown_cell(note)}\n" for note in table.notes)
    return text + ("\n" + notes if notes else "")


def latex(table: Table) -> str:
    """A booktabs tabular, its notes as comments."""

    def line(cells: Sequence[str]) -> str:
        return " & ".join(map(latex_cell, cells)) + r" \\"

    comments = [f"% {' '.join(note.split())}" for note in table.notes]
    lines = [
        r"% needs \usepackage{booktabs}",
        *comments,
        rf"\begin{{tabular}}{{{'l' * len(table.header)}}}",
        r"\toprule",
        line(table.header),
        r"\midrule",
        *map(line, table.rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def comma_separated(table: Table) -> str:
    """CSV with a header line; notes are not in it."""
    stream = io.StringIO()
    rows = [[csv_cell(cell) for cell in row] for row in (table.header, *table.rows)]
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


FORMATS: Final[dict[str, Callable[[Table], str]]] = {
    "md": markdown,
    "tex": latex,
    "csv": comma_separated,
}
