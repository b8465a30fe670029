"""A table as Markdown, LaTeX or CSV; the same cells in each."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

_MARKDOWN: Final = str.maketrans({"|": r"\|", "\\": r"\\", "\n": " "})
_LATEX: Final = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "_": r"\_",
        "%": r"\%",
        "&": r"\&",
        "#": r"\#",
        "$": r"\$",
        "{": r"\{",
        "}": r"\}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "↑": r"$\uparrow$",
        "↓": r"$\downarrow$",
        "\n": " ",
    }
)


@dataclass(frozen=True, kw_only=True)
class Table:
    """Text cells under their header. notes: sentences below it."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()


def markdown(table: Table) -> str:
    """A GitHub table, its notes as a list."""
    lines = [table.header, ["---"] * len(table.header), *table.rows]
    text = "".join(f"| {' | '.join(c.translate(_MARKDOWN) for c in line)} |\n" for line in lines)
    notes = "".join(f"- {note.translate(_MARKDOWN)}\n" for note in table.notes)
    return text + ("\n" + notes if notes else "")


def latex(table: Table) -> str:
    """A booktabs tabular, its notes as comments."""

    def line(cells: Sequence[str]) -> str:
        return " & ".join(c.translate(_LATEX) for c in cells) + r" \\"

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
    csv.writer(stream, lineterminator="\n").writerows([table.header, *table.rows])
    return stream.getvalue()


FORMATS: Final[dict[str, Callable[[Table], str]]] = {
    "md": markdown,
    "tex": latex,
    "csv": comma_separated,
}
