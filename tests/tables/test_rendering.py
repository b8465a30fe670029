"""One table in every format, to the last character; strangers' text stays text in each."""

from __future__ import annotations

import csv
import io
from html.parser import HTMLParser
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from legoworld.tables.files import comma_separated, latex, markdown
from legoworld.tables.html import html
from legoworld.tables.table import Column, Count, Number, Spread, Table, Text, line, table
from legoworld.tables.terminal import WIDTH, terminal

AP = Number(value=0.25, ends=(0.125, 0.5))
DROP = Number(value=-0.00001, ends=(-0.5, 0.00001), signed=True)
TIES = Number(value=0.5, sd=0.0625)
NONE = Number(value=None, ends=(0.0, 1.0))
#: A formula, a link, a picture, markup, TeX, and what controls a terminal.
HOSTILE = "=1|[a](b)<img src=x>\\input{x}&_%\x1b[2J\n\u202e"

EVERY = table(
    ["what", "value", "counts", "n"],
    [
        ["AP", AP, Count(n=3, of=7), 12],
        ["lost", DROP, Count(n=4), 3],
        [Text(text="ties", below="20 orders"), TIES, "-", 1],
        ["none", NONE, "", 0],
    ],
    title="Every kind",
    notes=["A | note."],
)


@pytest.mark.parametrize(
    ("cell", "shown"),
    [
        (AP, "0.2500 [0.1250, 0.5000]"),
        (DROP, "-0.0000 [-0.5000, +0.0000]"),
        (Number(value=-0.0, signed=True), "+0.0000"),
        (Number(value=-0.0, digits=1), "0.0"),
        (TIES, "0.5000 (sd 0.0625)"),
        (Number(value=0.5, ends=(0.25, 0.75), sd=0.1, digits=2), "0.50 [0.25, 0.75]"),
        (AP.without_interval, "0.2500"),
        (NONE, "-"),
        (Spread(of=AP), "[0.1250, 0.5000]"),
        (Spread(of=TIES), "sd 0.0625"),
        (Spread(of=NONE), "[0.0000, 1.0000]"),
        (Spread(of=Number(value=1.0)), "-"),
        (Count(n=3, of=7), "3 of 7"),
        (Count(n=3), "3"),
        (Text(text="a", below="b", link="c"), "a"),
        ("text", "text"),
        (12, "12"),
    ],
)
def test_a_cell_in_one_line(cell, shown):
    assert line(cell) == shown


def test_markdown():
    assert (
        markdown(EVERY)
        == r"""| what | value | counts | n |
| --- | --- | --- | --- |
| AP | 0.2500 [0.1250, 0.5000] | 3 of 7 | 12 |
| lost | -0.0000 [-0.5000, +0.0000] | 4 | 3 |
| ties | 0.5000 (sd 0.0625) | - | 1 |
| none | - |  | 0 |

- A \| note.
"""
    )


def test_latex():
    assert (
        latex(EVERY)
        == r"""% needs \usepackage{booktabs}
% A | note.
\begin{tabular}{llll}
\toprule
what & value & counts & n \\
\midrule
AP & 0.2500 [0.1250, 0.5000] & 3 of 7 & 12 \\
lost & -0.0000 [-0.5000, +0.0000] & 4 & 3 \\
ties & 0.5000 (sd 0.0625) & - & 1 \\
none & - &  & 0 \\
\bottomrule
\end{tabular}
"""
    )


def test_csv_has_numbers_unrounded_and_undefined_ones_empty():
    assert (
        comma_separated(EVERY)
        == """what,value,counts,n
AP,0.25,3 of 7,12
lost,-1e-05,4,3
ties,0.5,-,1
none,,,0
"""
    )


def test_terminal():
    assert (
        terminal(EVERY)
        == """Every kind
what  value                       counts   n
----  --------------------------  ------  --
AP    0.2500 [0.1250, 0.5000]     3 of 7  12
lost  -0.0000 [-0.5000, +0.0000]       4   3
ties  0.5000 (sd 0.0625)               -   1
none  -                                    0"""
    )


def test_terminal_with_intervals_below_their_numbers():
    assert (
        terminal(EVERY, stacked=True)
        == """Every kind
what         value               counts   n
-----------  ------------------  ------  --
AP           0.2500              3 of 7  12
             [0.1250, 0.5000]
lost         -0.0000                  4   3
             [-0.5000, +0.0000]
ties         0.5000                   -   1
  20 orders  sd 0.0625
none         -                            0
             [0.0000, 1.0000]"""
    )


def test_html():
    assert (
        html(EVERY)
        == """<h3>Every kind</h3>
<div class="scroll"><table class="numbers">
<thead><tr><th scope="col">what</th><th scope="col">value</th><th scope="col" class="n">counts</th>\
<th scope="col" class="n">n</th></tr></thead>
<tbody>
<tr><th scope="row">AP</th><td class="stack"><b>0.2500</b><br>[0.1250, 0.5000]</td>\
<td class="n">3 of 7</td><td class="n">12</td></tr>
<tr><th scope="row">lost</th><td class="stack"><b>-0.0000</b><br>[-0.5000, +0.0000]</td>\
<td class="n">4</td><td class="n">3</td></tr>
<tr><th scope="row">ties<br><span class="over">20 orders</span></th>\
<td class="stack"><b>0.5000</b><br>sd 0.0625</td><td class="n">-</td><td class="n">1</td></tr>
<tr><th scope="row">none</th><td class="stack"><b>-</b><br>[0.0000, 1.0000]</td>\
<td class="n"></td><td class="n">0</td></tr>
</tbody></table></div>
<p class="sub">A | note.</p>
"""
    )


def test_html_of_sides_that_a_page_sorts_and_folds():
    grouped = Table(
        columns=(
            Column(name="category", key="name"),
            Column(name="AP", group="one", key="ap0"),
            Column(name="TP", group="one", key="tp0"),
            Column(name="over", group="two"),
        ),
        rows=(
            (Text(text="Cat", link="#/coco?cat=1&x"), Number(value=0.25, digits=2),
             Count(n=1, of=2), "2 images"),
            ("Dog", Number(value=None), "-", ""),
        ),
        title="more",
        folded=True,
        key="categories",
    )  # fmt: skip
    assert (
        html(grouped)
        == """<details><summary>more</summary>
<div class="scroll"><table class="sortable" data-table="categories">
<thead><tr><th scope="col" rowspan="2"><button type="button" data-sort="name">category</button>\
</th><th scope="colgroup" colspan="2">one</th><th scope="colgroup" colspan="1">two</th></tr><tr>\
<th scope="col" class="n"><button type="button" data-sort="ap0">AP</button></th>\
<th scope="col" class="n"><button type="button" data-sort="tp0">TP</button></th>\
<th scope="col">over</th></tr></thead>
<tbody>
<tr data-text="cat"><th scope="row" data-key="name" data-v="Cat">\
<a href="#/coco?cat=1&amp;x">Cat</a></th>\
<td class="n" data-key="ap0" data-v="0.25"><b>0.25</b></td>\
<td class="n" data-key="tp0" data-v="1">1 of 2</td><td class="over">2 images</td></tr>
<tr data-text="dog"><th scope="row" data-key="name" data-v="Dog">Dog</th>\
<td class="n" data-key="ap0" data-v=""><b>-</b></td><td class="n" data-key="tp0" data-v="">-</td>\
<td class="over"></td></tr>
</tbody></table></div>
</details>
"""
    )


def test_the_widest_column_is_wrapped_and_a_table_of_many_columns_left():
    words = " ".join(["word"] * 40)
    shown = terminal(table(["name", "said", "n"], [["a", words, 1], ["b", "short", 22]]))
    assert shown.splitlines() == [
        f"name  {'said':<89}   n",
        f"----  {'-' * 89}  --",
        f"a     {' '.join(['word'] * 18):<89}   1",
        f"      {' '.join(['word'] * 18)}",
        f"      {' '.join(['word'] * 4)}",
        f"b     {'short':<89}  22",
    ]
    wide = table([f"column {k}" for k in range(12)], [["twelve chars"] * 12])
    assert len(terminal(wide).splitlines()) == 3


def test_denominators_are_filled_into_the_room_that_numbers_leave():
    over = ", ".join(f"{k} things" for k in range(12))
    shown = terminal(
        table(["metric", "x" * 40], [[Text(text="AP", below=over), AP]]), stacked=True
    ).splitlines()
    assert max(map(len, shown)) <= WIDTH
    assert [text[:2] for text in shown[2:]] == ["AP", "  ", "  ", "  "]
    assert " ".join(text[:56].split("  [")[0].strip() for text in shown[3:]) == over


def test_tables_without_rows_or_columns():
    empty = table(["a", "bb"], [])
    assert terminal(empty) == "a  bb\n-  --"
    assert markdown(empty) == "| a | bb |\n| --- | --- |\n"
    assert comma_separated(empty) == "a,bb\n"
    assert "<tbody>\n</tbody>" in html(empty)
    assert terminal(table([], [])) == "\n"


class Tags(HTMLParser):
    """Names of elements, and the text of well-nested HTML."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: Any) -> None:  # noqa: ARG002
        self.names.append(tag)
        if tag != "br":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def everywhere(text: str) -> Table:
    """A table with the same text in each place that a stranger can name."""
    return Table(
        columns=(Column(name=text, key=text), Column(name="n", group=text)),
        rows=((Text(text=text, below=text, link=f"#/{text}"), Number(value=1.0, below=text)),),
        title=text,
        notes=(text,),
        key=text,
    )


def test_text_of_strangers_is_text_in_every_format():
    hostile = everywhere(HOSTILE)
    shown = terminal(hostile, stacked=True)
    assert "\x1b" not in shown
    assert "\u202e" not in shown
    assert len(shown.splitlines()) == 5
    assert "<img" not in markdown(hostile)
    assert "](b)" not in markdown(hostile)
    assert len(markdown(hostile).splitlines()) == 5
    assert r"\input" not in latex(hostile).split(r"\toprule")[1]
    assert len(latex(hostile).splitlines()) == 9
    assert all(row[0][:2] == "'=" for row in csv.reader(io.StringIO(comma_separated(hostile))))
    assert "img" not in Tags(html(hostile)).names


@given(st.text(min_size=1))
def test_no_text_adds_an_element_or_a_row(text):
    plain, found = Tags(html(everywhere("x"))), Tags(html(everywhere(text)))
    assert found.names[found.names.index("table") :] == plain.names[plain.names.index("table") :]
    rows = list(csv.reader(io.StringIO(comma_separated(everywhere(text)))))
    assert [len(row) for row in rows] == [2, 2]
    assert len(terminal(table(["a"], [[text]])).splitlines()) >= 3
