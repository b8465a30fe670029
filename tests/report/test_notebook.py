"""What a notebook shows of results: the report's own sentence and numbers, as plain HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from report.pages import HOSTILE, evaluate

import legoworld
from legoworld.records.report_tables import ForestRow, Span
from legoworld.report.notebook import (
    _DIFFERENCE,
    _GAP,
    _LEFT,
    _WIDTH,
    _forest,
    instances_text,
    picture_html,
)


class Checked(HTMLParser):
    """Text of well-nested HTML; void elements aside, every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""
        self.names: set[str] = set()
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: Any) -> None:  # noqa: ARG002
        self.names.add(tag)
        if tag not in ("img", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:  # noqa: ARG002
        self.names.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_an_evaluation_shows_its_metrics(tmp_path: Path) -> None:
    found = legoworld.Evaluation.open(evaluate(tmp_path, "coco", statuses={10: "failed"}))
    shown = Checked(found._repr_html_())
    ap = found.summary.intervals["AP"]
    assert f"AP {found.metrics['AP']:.3f} [{ap.low:.3f}, {ap.high:.3f}]" in shown.text
    assert "1 failed" in shown.text
    for name in ("AP50", "recall at IoU 0.5"):
        assert name in shown.text
    assert f"AP{found.metrics['AP']:.4f}[{ap.low:.4f}, {ap.high:.4f}]12 images" in shown.text
    assert shown.names <= {
        *("div", "p", "b", "svg", "line", "circle", "text", "details", "summary", "h3"),
        *("table", "thead", "tbody", "tr", "th", "td"),
    }


def test_a_comparison_shows_its_verdict(tmp_path: Path) -> None:
    sides = [
        evaluate(tmp_path, "lvis"),
        evaluate(tmp_path, "lvis", levels=None, kind="baseline", baseline=f"random {HOSTILE}"),
    ]
    found = legoworld.compare(sides, tmp_path / "comparison", draws=20)
    shown = Checked(found._repr_html_())
    row = next(r for r in found.table if r["metric"] == "AP" and r["images"] == "paired")
    assert f"difference {row['difference']:+.3f} [{row['low']:+.3f}, {row['high']:+.3f}]" in (
        shown.text
    )
    assert " of 12 images paired: " in shown.text
    assert HOSTILE in shown.text
    assert "img" not in shown.names


def span(value: float | None, low: float | None = None, high: float | None = None) -> Span:
    return Span(value=value, low=low, high=high, over="")


def drawn(*rows: ForestRow, labels: Sequence[str] = ()) -> tuple[list[dict[str, str]], ...]:
    """Attributes of the plot's circles and of its intervals' lines."""
    root = ElementTree.fromstring(_forest(rows, labels))
    circles, lines = (
        [one.attrib for one in root if one.tag.endswith(kind)] for kind in ("circle", "line")
    )
    return circles, [line for line in lines if line.get("stroke-width") == "2"]


def test_points_and_intervals_stand_where_the_numbers_say() -> None:
    sides = (span(0.5, 0.25, 0.75), span(0.25), None, span(None))
    row = ForestRow(name="AP", better="higher", sides=sides, differences=())
    circles, lines = drawn(row)
    assert [float(c["cx"]) for c in circles] == [_LEFT + _WIDTH / 2, _LEFT + _WIDTH / 4]
    (line,) = lines
    assert (float(line["x1"]), float(line["x2"])) == (_LEFT + _WIDTH / 4, _LEFT + _WIDTH * 3 / 4)
    assert line["y1"] == line["y2"] == circles[0]["cy"]
    assert len({c["fill"] for c in circles}) == 2
    beyond = ForestRow(name="x", better="lower", sides=(span(3.0, -1.0, 9.0),), differences=())
    (circle,), (line,) = drawn(beyond)
    ends = [float(x) for x in (circle["cx"], line["x1"], line["x2"])]
    assert ends == [_LEFT + _WIDTH, _LEFT, _LEFT + _WIDTH]


def test_a_difference_apart_from_zero_has_a_colour_of_its_own() -> None:
    spans = [span(0.2, 0.1, 0.3), span(-0.2, -0.3, -0.1), span(0.1, 0, 0.2), span(0.1, -0.1, 0),
             span(0.1)]  # fmt: skip
    rows = [ForestRow(name="AP", better="higher", sides=(), differences=(s,)) for s in spans]
    circles, lines = drawn(*rows)
    first, second, *others = (c["fill"] for c in circles)
    assert first == second
    assert len({*others}) == 1
    assert first not in others
    assert len(lines) == 4
    places = [float(c["cx"]) for c in circles]
    middle = (places[0] + places[1]) / 2
    assert places[2] == pytest.approx((places[0] + middle) / 2, abs=0.1)
    heights = [float(c["cy"]) for c in circles]
    assert heights == sorted({*heights})


def test_each_side_is_in_the_legend_in_its_colour() -> None:
    row = ForestRow(name="AP", better="higher", sides=(span(0.5), span(0.25)), differences=())
    circles, _ = drawn(row, labels=("one", "another"))
    legend, points = circles[:2], circles[2:]
    assert [c["fill"] for c in legend] == [c["fill"] for c in points]
    apart = float(legend[1]["cx"]) - float(legend[0]["cx"])
    assert apart > 7 * len("one"), "the words do not run into each other"


def test_a_view_shows_its_picture() -> None:
    shown = Checked(picture_html(np.zeros((4, 5, 3), np.uint8), "a < b"))
    assert shown.text == "a < b"
    assert instances_text([]) == "no instances"


@pytest.mark.blender
def test_an_opened_scene_s_view_shows_its_overlay() -> None:
    view = legoworld.open_scene(Path(__file__).parents[2] / "examples" / "chelsea").view(
        task="coco"
    )
    text = view._repr_html_()
    assert text.startswith('<div><img src="data:image/png;base64,')
    assert "cat" in Checked(text).text


def test_ticks_and_differences_stand_at_their_values_and_beside_each_other() -> None:
    """Three differences of up to 0.5; the plot is `_DIFFERENCE` wide with 20 px at each end."""
    spans = (span(0.5, 0.4, 0.5), span(-0.25), span(0.0))
    row = ForestRow(name="AP", better="higher", sides=(), differences=spans)
    root = ElementTree.fromstring(_forest([row], ()))
    middle, reach = _LEFT + _WIDTH + _GAP + _DIFFERENCE / 2, _DIFFERENCE / 2 - 20
    ticks = {
        one.text: float(one.attrib["x"])
        for one in root
        if one.attrib.get("text-anchor") == "middle"
    }
    assert ticks["+0.5"] == pytest.approx(middle + reach, abs=0.1)
    assert ticks["-0.5"] == pytest.approx(middle - reach, abs=0.1)
    assert ticks["0.25"] == pytest.approx(_LEFT + _WIDTH / 4, abs=0.1)
    assert float(root.attrib["width"]) == _LEFT + _WIDTH + _GAP + _DIFFERENCE
    circles, _ = drawn(row)
    assert [float(c["cx"]) for c in circles] == pytest.approx(
        [middle + reach, middle - reach / 2, middle], abs=0.1
    )
    assert [float(c["cy"]) - 30 for c in circles] == [-9, 0, 9], "the first above"
    sides = ForestRow(name="AP", better="higher", sides=(span(0.5),) * 4, differences=())
    circles, _ = drawn(sides)
    assert [float(c["cy"]) - 30 for c in circles] == [-13.5, -4.5, 4.5, 13.5]
    assert circles[2]["fill"] == circles[3]["fill"] != circles[1]["fill"]
    root = ElementTree.fromstring(_forest([sides], ()))
    assert float(root.attrib["width"]) == _LEFT + _WIDTH + _GAP
