"""Text as a cell of a table, for each format that is written; names come from strangers."""

from __future__ import annotations

import math
from typing import Final

from legoworld.errors import printable

#: What a cell of a table shows.
Cell = str | int | float | None

#: First characters that make a spreadsheet read a cell as a formula (OWASP, CSV injection).
_FORMULA: Final = ("=", "+", "-", "@", "\t")
_MARKDOWN: Final = str.maketrans(
    {"|": r"\|", "\\": r"\\", "<": "&lt;", "`": r"\`", "*": r"\*", "\n": " ", "\r": " "}
)
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
        "\r": " ",
    }
)


def csv_cell(text: str) -> str:
    """A cell that no spreadsheet evaluates: an apostrophe before a formula's first character.

    Numbers and the "-" of an empty cell stay as they are. Quoting is the CSV writer's.
    """
    text = printable(text)  # a carriage return, too, is replaced
    plain = text == "-" or not text.startswith(_FORMULA) or _is_number(text)
    return text if plain else f"'{text}"


def markdown_cell(text: str) -> str:
    """A cell or list item without markup: no HTML, links, pictures, code or emphasis."""
    shown = printable(text).translate(_MARKDOWN)
    for bracket in "([:":  # what makes a link of the text before it
        shown = shown.replace(f"]{bracket}", rf"]\{bracket}")
    return shown


def latex_cell(text: str) -> str:
    r"""A cell of a tabular. `[` and `*` after the `\\` of the line above would be its argument."""
    shown = printable(text).translate(_LATEX)
    return "{}" + shown if shown.lstrip().startswith(("[", "*")) else shown


def _is_number(text: str) -> bool:
    try:
        return text.strip() == text and not math.isnan(float(text))
    except ValueError:
        return False
