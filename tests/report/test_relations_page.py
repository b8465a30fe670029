"""A page of relations in a browser: a question that is chosen is drawn between its two things."""

from __future__ import annotations

from evaluation.relations.folders import STREET, TABLE, call, evaluated, write_facts
from report.chromium import browser


def test_a_question_is_drawn_between_its_things(tmp_path):
    run = write_facts(tmp_path / "run", {"a.jpg": TABLE, "b.jpg": STREET, "c.jpg": None})
    evaluated(run, run, tmp_path / "eval")
    assert call("report", tmp_path / "eval", "-o", tmp_path / "page.html") == 0
    with browser(viewport={"width": 1200, "height": 900}) as page:
        page.open(tmp_path / "page.html", "#/relations/1")
        page.until("document.querySelectorAll('g.relation .thing').length > 0")
        first = page.js("document.querySelector('g.relation title').textContent")
        assert first in page.js("document.querySelector('.pick.question.pinned').textContent")
        page.js(
            "[...document.querySelectorAll('.pick.question')]"
            ".find((b) => b.textContent.includes('in front of')).click()"
        )
        boxes = page.js(
            "[...document.querySelectorAll('g.relation')].map((g) => [g.querySelectorAll('.thing')"
            ".length, g.querySelectorAll('.between').length, g.querySelector('title').textContent])"
        )
        assert {tuple(box[:2]) for box in boxes} == {(2, 1)}
        assert "in front of" in boxes[0][2]
        page.open(tmp_path / "page.html", "#/relations?tab=photos")
        page.until("document.querySelectorAll('.card').length === 3")
        assert "accuracy" in page.js("document.querySelector('.card .marks').textContent")
        assert page.said == []
