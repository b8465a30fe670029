"""The page of label maps: panes and cards in a browser, and the list without scripts."""

from __future__ import annotations

import re

import numpy as np
import pytest
from evaluation.panoptic.panoptic_files import call, scored, write_panoptic
from report.chromium import browser
from report.pages import document_of

PERSON, CAR, WALL = 1, 3, 199


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One evaluation of two images, of which one has no answer, and its page."""
    folder = tmp_path_factory.mktemp("maps")
    ids = np.repeat([[1, 1, 2], [1, 0, 2]], 20, axis=0)
    pictures = {1: (ids, [(1, PERSON, 0), (2, WALL, 0)])}
    pictures[2] = pictures[1]
    truth = write_panoptic(folder / "truth.json", pictures)
    answers = {1: (np.where(ids == 2, 2, 0), [(2, WALL, 0)])}
    scored(folder, truth, write_panoptic(folder / "theirs.json", answers, truth=False), code=1)
    call("report", folder / "eval", "-o", folder / "page.html")
    return folder


@pytest.fixture(scope="module")
def page(folder):
    return folder / "page.html"


def test_what_a_photo_s_cell_and_its_answer_say(folder):
    document = document_of(folder / "eval")
    (section,) = document.sections
    missing, answered = section.images  # without a score first
    assert (answered.id, answered.file_name, answered.n_truth) == (1, "1.jpg", 2)
    (cell,) = answered.cells
    assert (cell.metric, cell.status, cell.advice, cell.findings) == ("PQ", "ok", "", 0)
    assert (cell.quality, cell.counts) == (0.5, (1, 0, 1))
    assert set(answered.categories) == {PERSON, WALL}
    assert section.names[str(PERSON)] == "person"
    (cell,) = missing.cells
    assert (cell.status, cell.quality, cell.findings) == ("missing", None, 1)
    assert cell.advice
    first, second = document.views
    facts = dict(first.sides[0].facts)
    assert (facts["PQ"], facts["SQ"], facts["RQ"]) == ("0.5000", "0.5000", "0.5000")
    assert [a.level for a in first.sides[0].advice] == []
    assert [a.level for a in second.sides[0].advice] == ["bad"]
    assert first.sides[0].label == section.sides[0].label
    assert (first.section, first.id, first.size_wh) == (section.key, 1, (3, 40))
    places = [(v.maps.truth, *v.maps.answers, *v.maps.agreements) for v in (first, second)]
    assert places == [(0, 1, 2), (3, 4, 5)]
    assert len(document.overlays) == 6


def test_what_a_category_is_taken_for(tmp_path):
    """Columns 0 to 18 of the person are car and 20 to 28 wall; 19 and 29 are drawn as lines."""
    ids = np.array([[1] * 30 + [2] * 30] * 6)
    truth = write_panoptic(tmp_path / "truth.json", {1: (ids, [(1, PERSON, 0), (2, WALL, 0)])})
    answer = np.array([[3] * 20 + [2] * 40] * 6)
    answers = {1: (answer, [(3, CAR, 0), (2, WALL, 0)])}
    scored(tmp_path, truth, write_panoptic(tmp_path / "theirs.json", answers, truth=False))
    (section,) = document_of(tmp_path / "eval").sections
    texts = [cost.text for cost in section.first.costs[0].most]
    assert "person: 1 of 1 segment missed; 68% of its wrong pixels are car" in texts
    assert not any("wall" in text and "wrong pixels" in text for text in texts)


def test_a_photo_has_panes_of_truth_and_answer(page):
    with browser() as chromium:
        chromium.open(page, "#/coco-panoptic/1")
        chromium.until("document.querySelectorAll('.pane').length === 3")
        titles = chromium.js(
            "[...document.querySelectorAll('.pane figcaption')].map(e => e.textContent)"
        )
        assert titles == ["ground truth", "theirs", "theirs: right and wrong"]
        shown = "[...document.querySelectorAll('.pane image')].map(e => e.getAttribute('href'))"
        assert all(url.startswith("data:image/webp") for url in chromium.js(shown))
        assert "PQ of this photo 0.5000" in chromium.js(
            "document.querySelector('#detail').innerText"
        )
        chromium.open(page, "#/coco-panoptic/2")
        chromium.until("document.querySelector('#detail .flag') !== null")
        assert chromium.js("document.querySelectorAll('.pane').length") == 3
        chromium.open(page, "#/coco-panoptic?tab=photos")
        chromium.until("document.querySelectorAll('[data-gallery] .mark').length === 2")
        marks = chromium.js("[...document.querySelectorAll('.mark')].map(e => e.textContent)")
        assert {"0.50 PQ", "missing"} <= set(marks)
        assert chromium.said == []


def test_the_list_and_the_tables_need_no_script(page):
    text = page.read_text()
    assert "The number on a card is PQ of the photo alone" in text
    assert re.search(r"2\.jpg</th>.*?missing", text, re.S)
    assert "AbsRel" not in re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert "k-tp" not in re.sub(r"<(script|style).*?</\1>", "", text, flags=re.S)
