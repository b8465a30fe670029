"""Cells of tables: whatever a stranger's name is, it is text in every format."""

from __future__ import annotations

import csv
import io

import pytest

from legoworld.escaping import csv_cell, latex_cell, markdown_cell
from legoworld.tables.files import comma_separated, latex, markdown
from legoworld.tables.table import table

FORMULAS = ["=HYPERLINK(1)", "+cmd|' /C calc'!A0", "-2+3", "@SUM(1)", "\t=1", "--", "+nan"]


@pytest.mark.parametrize("text", FORMULAS)
def test_a_cell_that_a_spreadsheet_would_evaluate_begins_with_an_apostrophe(text):
    assert csv_cell(text).startswith("'")
    rows = list(csv.reader(io.StringIO(comma_separated(table([text], [[text]])))))
    assert all(cell.startswith("'") for row in rows for cell in row)


@pytest.mark.parametrize("text", ["-", "-0.5", "+0.25", "-1e-05", "3", "", "-inf", "gpt-5", "a=b"])
def test_numbers_and_plain_names_stay(text):
    assert csv_cell(text) == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("<img src=x onerror=alert(1)>", "&lt;img src=x onerror=alert(1)>"),
        ("![x](http://tracker/)", r"![x]\(http://tracker/)"),
        ("[a][b] [c]: d", r"[a]\[b] [c]\: d"),
        ("`code` *bold* a|b", r"\`code\` \*bold\* a\|b"),
        ("two\nlines", "two lines"),
        ("\x1b[31mred\u202e", "\ufffd[31mred\ufffd"),
        ("+0.5 [-0.1, 0.2]", "+0.5 [-0.1, 0.2]"),
    ],
)
def test_markdown_cells_hold_no_markup(text, shown):
    assert markdown_cell(text) == shown
    assert shown in markdown(table(["a"], [[text]], notes=[text]))


@pytest.mark.parametrize("text", ["[2cm] name", "*name"])
def test_a_latex_line_does_not_begin_with_an_argument_of_the_line_above(text):
    assert latex_cell(text) == "{}" + text
    assert f"\n{{}}{text} \\\\" in latex(table(["a"], [[text]]))
