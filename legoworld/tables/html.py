"""A table as HTML, for the report's page, a trajectory's, and notebooks; all text is escaped."""

from __future__ import annotations

from html import escape
from itertools import groupby

from legoworld.tables.table import Cell, Column, Count, Number, Table, Text


def html(table: Table) -> str:
    """The table in a box that scrolls, under its title; notes are paragraphs after it."""
    named = f'class="sortable" data-table="{escape(table.key)}"' if table.key else 'class="numbers"'
    box = (
        f'<div class="scroll"><table {named}>\n<thead>{_head(table)}</thead>\n'
        f"<tbody>\n{_body(table)}</tbody></table></div>\n"
    )
    box += "".join(f'<p class="sub">{escape(note)}</p>\n' for note in table.notes)
    if table.folded:
        return f"<details><summary>{escape(table.title)}</summary>\n{box}</details>\n"
    return (f"<h3>{escape(table.title)}</h3>\n" if table.title else "") + box


def _head(table: Table) -> str:
    """One row of headings; two where columns share one: `group` spans its columns."""
    columns = list(zip(table.columns, table.numeric, strict=True))
    if not any(column.group for column in table.columns):
        return f"<tr>{''.join(_heading(*column) for column in columns)}</tr>"
    top, below = "", ""
    for group, members in groupby(columns, key=lambda column: column[0].group):
        headings = [(column, number) for column, number in members]
        if group:
            top += f'<th scope="colgroup" colspan="{len(headings)}">{escape(group)}</th>'
            below += "".join(_heading(*heading) for heading in headings)
        else:
            top += "".join(_heading(*heading, rows=2) for heading in headings)
    return f"<tr>{top}</tr><tr>{below}</tr>"


def _heading(column: Column, number: bool, rows: int = 1) -> str:
    name = escape(column.name)
    if column.key:
        name = f'<button type="button" data-sort="{escape(column.key)}">{name}</button>'
    about = (f' rowspan="{rows}"' if rows > 1 else "") + (' class="n"' if number else "")
    return f'<th scope="col"{about}>{name}</th>'


def _body(table: Table) -> str:
    lines = []
    columns = list(zip(table.columns, table.numeric, strict=True))
    for row in table.rows:
        cells = [_cell(cell, *columns[k], first=k == 0) for k, cell in enumerate(row)]
        found = f' data-text="{escape(str(row[0]).lower())}"' if table.key else ""
        lines.append(f"<tr{found}>{''.join(cells)}</tr>\n")
    return "".join(lines)


def _cell(cell: Cell, column: Column, number: bool, *, first: bool) -> str:
    stacked = isinstance(cell, Number) and bool(cell.interval_text or cell.below)
    kind = "stack" if stacked else "n" if number else "over" if column.group else ""
    about = f' class="{kind}"' if kind else ""
    if column.key:
        about += f' data-key="{escape(column.key)}" data-v="{escape(_sorted_by(cell))}"'
    text = escape(str(cell))
    if isinstance(cell, Number) and (stacked or column.group):
        text = f"<b>{text}</b>"
    if isinstance(cell, Text) and cell.link:
        text = f'<a href="{escape(cell.link)}">{text}</a>'
    if isinstance(cell, Number) and cell.interval_text:
        text += f"<br>{escape(cell.interval_text)}"
    if isinstance(cell, Number | Text) and cell.below:
        text += f'<br><span class="over">{escape(cell.below)}</span>'
    return f'<th scope="row"{about}>{text}</th>' if first else f"<td{about}>{text}</td>"


def _sorted_by(cell: Cell) -> str:
    """What a page's scripts sort by: a number unrounded, nothing for none."""
    if isinstance(cell, Number):
        return "" if cell.value is None else repr(cell.value)
    text = str(cell.n) if isinstance(cell, Count) else str(cell)
    return "" if text == "-" else text
