"""The page to scrub through: what each call left, what lowered Q, by keys, in both schemes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from report.chromium import Browser, browser
from trajectories.pages import LEFT, picture, recorded, scored

from legoworld.trajectories.showing import calls_table, write_page

AXE = Path(__file__).parents[2] / "tools" / "page" / "node_modules" / "axe-core" / "axe.min.js"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    trial = recorded(folder / "scenes")
    scored(folder / "scores", trial)
    picture(folder / "photos" / "room.png", (200, 180, 120))
    write_page([trial], folder / "page.html", photos=folder / "photos", scores=folder / "scores")
    return folder / "page.html"


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    with browser(bypass_csp=True) as opened:
        yield opened


def embedded(page: Path) -> Any:
    found = re.search(r'id="data">(.*?)</script>', page.read_text(), re.DOTALL)
    assert found
    return json.loads(found[1])[0]


def test_each_call_has_its_scene_its_q_and_its_place_on_three_axes(page):
    steps = embedded(page)["steps"]
    assert [step["Q"] is not None for step in steps] == [
        LEFT.get(n) is not None for n in range(1, 7)
    ]
    assert [step["shown"] for step in steps] == [1, 2, 2, 4, 5, 6]
    assert len({step["render"] for step in steps}) == 5
    for axis in range(3):
        shares = [step["shares"][axis] for step in steps]
        assert shares == sorted(shares)
        assert shares[-1] <= 1
    assert [step["drop"] for step in steps] == [None, None, None, "geometry", None, None]
    assert steps[3]["lost"] == pytest.approx(-0.175)
    assert "camera" in steps[4]["reason"]


def test_a_call_that_changed_and_saved_has_the_q_of_what_it_changed(tmp_path):
    trial = recorded(tmp_path / "scenes")
    document = scored(tmp_path / "scores", trial)
    shown = [str(row[5]) for row in calls_table(trial, document.trials[0]).rows]
    assert shown == ["0.4000", "0.6500", "", "0.4750", "-", "0.5500"]


def test_without_scores_and_photos_there_is_the_submission_alone(tmp_path):
    trial = recorded(tmp_path / "scenes", tokens=False)
    write_page([trial], tmp_path / "page.html", photos=None, scores=None)
    found = embedded(tmp_path / "page.html")
    assert found["photo"] is None
    assert found["final"].startswith("data:image/webp")
    assert {step["render"] for step in found["steps"]} == {None}
    assert {step["shares"][2] for step in found["steps"]} == {None}


def test_keys_scrub_and_a_drop_leads_to_its_call(chrome, page):
    chrome.open(page)
    assert "call 6 of 6" in chrome.js("document.getElementById('said').textContent")
    chrome.page.focus("#step")
    for _ in range(2):
        chrome.page.keyboard.press("ArrowLeft")
    said = chrome.js("document.getElementById('said').textContent")
    assert "call 4 of 6" in said
    assert "lowers Q by 0.1750: geometry" in said
    assert "'call'] = 4" in chrome.js("document.getElementById('code').textContent")
    chrome.page.keyboard.press("ArrowLeft")
    rendered = chrome.js("document.getElementById('rendered').textContent")
    assert rendered == "The scene after call 2, which call 3 left as it was"
    chrome.page.focus("#drops button")
    chrome.page.keyboard.press("Enter")
    assert "call 4 of 6" in chrome.js("document.getElementById('said').textContent")
    for axis in ("1", "2", "0"):
        chrome.page.select_option("#axis", axis)
        assert chrome.js("document.querySelectorAll('#curve line').length") == 8
    assert chrome.said == []
    assert [address for address in chrome.asked if not address.startswith(("file:", "data:"))] == []


@pytest.mark.parametrize("width", [390, 1400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_and_nothing_sticks_out(chrome, page, width, scheme):
    if not AXE.is_file():
        pytest.skip("axe-core is not installed: run npm ci in tools/page")
    chrome.prefer(scheme)
    chrome.resize(width)
    chrome.open(page)
    chrome.page.evaluate(AXE.read_text(encoding="utf-8"))
    result = chrome.js("axe.run(document, { resultTypes: ['violations'] })")
    assert [(v["id"], [n["html"][:160] for n in v["nodes"]]) for v in result["violations"]] == []
    assert chrome.js("document.documentElement.scrollWidth") <= width
