"""What a notebook shows of results: the report's own sentence and numbers, as plain HTML."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report.pages import HOSTILE, evaluated

import legoworld
from legoworld.report.notebook import instances_text, picture_html


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
    found = legoworld.Evaluation.open(evaluated(tmp_path, "coco", statuses={10: "failed"}))
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
        evaluated(tmp_path, "lvis"),
        evaluated(tmp_path, "lvis", levels=None, kind="baseline", baseline=f"random {HOSTILE}"),
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
