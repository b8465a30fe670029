"""A page of relations in a browser: a question that is chosen is drawn between its two things."""

from __future__ import annotations

from evaluation.relations.folders import STREET, TABLE, call, evaluated, write_facts
from report.chromium import browser
from report.pages import document_of


def test_what_a_photo_s_cell_and_its_answer_say(tmp_path):
    truth = write_facts(tmp_path / "truth", {"a.jpg": TABLE, "b.jpg": STREET, "c.jpg": TABLE})
    run = write_facts(tmp_path / "run", {"a.jpg": TABLE, "b.jpg": TABLE, "c.jpg": None})
    evaluated(run, truth, tmp_path / "eval")
    document = document_of(tmp_path / "eval")
    (section,) = document.sections
    rows = {row.id: row.cells[0] for row in section.images}
    assert (rows[1].status, rows[1].accuracy, rows[1].findings) == ("ok", 1.0, 0)
    assert rows[1].answered > 0
    assert rows[1].advice == ""
    views = {view.id: view for view in document.views}
    wrong = [q for q in views[2].questions[0] if q.score is not None and q.score < 1]
    assert wrong
    bad = [a for a in views[2].sides[0].advice if a.level == "bad"]
    assert rows[2].findings == len(bad) > 0
    assert bad[0].what == f"{wrong[0].text} {wrong[0].answer}, truly {wrong[0].truth}"
    assert rows[2].advice == views[2].sides[0].advice[0].what
    assert rows[2].accuracy < 1
    assert (rows[3].status, rows[3].findings) != ("ok", 0)
    assert [(v.section, v.file_name) for v in document.views] == [
        (section.key, name) for name in ("a.jpg", "b.jpg", "c.jpg")
    ]


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
