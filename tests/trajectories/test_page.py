"""The page to scrub through: what each call left, what lowered Q, by keys, in both schemes."""

from __future__ import annotations

import base64
import json
import re
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from evaluation.detection_runs import random_truth
from msgspec.structs import replace as msgspec_replace
from report.chromium import Browser, browser
from report.pages import evaluate
from trajectories.pages import LEFT, picture, record_trial, score_trial

from legoworld import cli
from legoworld.trajectories.page import _picture, _tables, calls_table, write_page
from legoworld.trajectories.score_checkpoints import _groups, slot_folder

EXAMPLES = Path(__file__).parents[2] / "examples"
AXE = Path(__file__).parents[2] / "tools" / "page" / "node_modules" / "axe-core" / "axe.min.js"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    trial = record_trial(folder / "scenes")
    score_trial(folder / "scores", trial)
    picture(folder / "photos" / "room.png", (200, 180, 120))
    write_page([trial], folder / "page.html", photos=folder / "photos", scores=folder / "scores")
    return folder / "page.html"


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    with browser(bypass_csp=True) as opened:
        yield opened


def embedded_data(page: Path) -> Any:
    found = re.search(r'id="data">(.*?)</script>', page.read_text(), re.DOTALL)
    assert found
    return json.loads(found[1])[0]


def test_each_call_has_its_scene_its_q_and_its_place_on_three_axes(page):
    steps = embedded_data(page)["steps"]
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
    trial = record_trial(tmp_path / "scenes")
    document = score_trial(tmp_path / "scores", trial)
    shown = [str(row[5]) for row in calls_table(trial, document.trials[0]).rows]
    assert shown == ["0.4000", "0.6500", "", "0.4750", "-", "0.5500"]


def test_means_stand_over_all_images_and_over_the_common_ones(tmp_path):
    document = score_trial(tmp_path / "scores", record_trial(tmp_path / "scenes"))
    (alone,) = _tables(document)
    assert alone.title == "All images"
    assert len(alone.rows) == len(document.agents[0].means)
    shared = msgspec_replace(document, common=document.agents, common_images=(1, 5))
    first, second = _tables(shared)
    assert first == alone
    assert second == msgspec_replace(alone, title="The 2 common images")
    assert _tables(None) == []


def test_what_a_call_said_is_cut_at_sixty_letters(tmp_path):
    trial = record_trial(tmp_path / "scenes")
    said = "".join(chr(ord("a") + k % 26) for k in range(70))
    long = replace(trial, calls=tuple(msgspec_replace(c, said=said) for c in trial.calls))
    rows = calls_table(long, None).rows
    assert {str(row[6]) for row in rows} == {said[:60]}
    assert {str(row[5]) for row in rows} == {""}


def test_a_picture_is_shrunk_by_the_mean_of_its_pixels(tmp_path):
    stripes = np.zeros((1440, 1920, 3), np.uint8)
    stripes[:, ::4] = 240
    cv2.imwrite(str(tmp_path / "p.png"), stripes)
    data = base64.b64decode(_picture(tmp_path / "p.png").partition(",")[2])
    small = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert small.shape == (360, 480, 3)
    assert np.abs(small.astype(int) - 60).max() <= 3
    assert _picture(tmp_path / "none.png") is None
    (tmp_path / "text.png").write_text("no picture")
    assert _picture(tmp_path / "text.png") is None


def test_a_small_picture_keeps_its_size_and_colours(tmp_path):
    picture(tmp_path / "p.png", (200, 20, 90))  # blue first
    data = base64.b64decode(_picture(tmp_path / "p.png").partition(",")[2])
    small = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert small.shape == (96, 128, 3)
    assert np.abs(small.astype(int) - [200, 20, 90]).max() <= 6


def test_trials_are_grouped_by_run_and_each_has_its_slot(tmp_path):
    scenes, output = tmp_path / "scenes", tmp_path / "out"
    for run in ("run_2", "run_10"):
        record_trial(scenes / run)
    groups = _groups(scenes)
    assert [(g.run, g.agent, len(g.trials)) for g in groups] == [(2, "codex", 1), (10, "codex", 1)]
    assert len({g.name for g in groups}) == 2
    for group in groups:
        (trial,) = group.trials
        assert slot_folder(output, trial, 4) == output / group.name / "005" / "scenes"
    record_trial(tmp_path / "plain")
    record_trial(tmp_path / "plain" / "run_x")
    (group,) = _groups(tmp_path / "plain")
    assert (group.run, len(group.trials)) == (1, 2)
    own = next(t for t in group.trials if t.folder.parent.name == "plain")
    assert slot_folder(output, own, 0) == output / group.name / "001" / "scenes"


def test_without_scores_and_photos_there_is_the_submission_alone(tmp_path):
    trial = record_trial(tmp_path / "scenes", tokens=False)
    write_page([trial], tmp_path / "page.html", photos=None, scores=None)
    found = embedded_data(tmp_path / "page.html")
    assert found["photo"] is None
    assert found["final"].startswith("data:image/webp")
    assert {step["render"] for step in found["steps"]} == {None}
    assert {step["shares"][2] for step in found["steps"]} == {None}


def test_photos_are_found_below_val2017_and_what_is_missing_is_said(tmp_path, capsys):
    record_trial(tmp_path / "scenes")
    words = ["trajectory", "report", str(tmp_path / "scenes"), "-o", str(tmp_path / "page.html")]
    picture(tmp_path / "photos" / "val2017" / "room.png", (200, 180, 120))
    assert cli.run([*words, "--photos", str(tmp_path / "photos")]) == 0
    assert embedded_data(tmp_path / "page.html")["photo"].startswith("data:image/webp")
    assert "not found" not in capsys.readouterr().err
    (tmp_path / "other").mkdir()
    assert cli.run([*words, "--photos", str(tmp_path / "other")]) == 0
    assert "1 photo not found" in capsys.readouterr().err


def test_the_page_and_the_report_lead_to_each_other(chrome, tmp_path):
    """A report of boxes whose photo is called as the trial's scene."""
    truth = random_truth("coco", seed=1, images=2)
    truth["images"][1]["file_name"] = "room.png"
    boxes = evaluate(tmp_path, "coco", truth=truth)
    record_trial(tmp_path / "scenes")
    report, page = tmp_path / "my report.html", tmp_path / "page.html"
    words = ["trajectory", "report", str(tmp_path / "scenes"), "-o", str(page)]
    assert cli.run([*words, "--report", str(report)]) == 0
    words = ["report", str(boxes), "-o", str(report), "--trials", str(page)]
    assert cli.run(words) == 0
    chrome.open(page)
    assert chrome.page.locator("#unscored").is_visible()
    chrome.page.locator("#report").click()
    chrome.until("document.querySelector('[data-gallery] a.card')")
    chrome.page.locator("[data-gallery] a.card").click()
    chrome.page.get_by_text("how it was made").click()
    chrome.until("document.getElementById('which')")
    assert chrome.js("decodeURIComponent(location.pathname + location.hash)").endswith(
        "page.html#room"
    )
    chrome.said.clear()


def test_the_submission_is_there_in_3d_from_its_own_camera(chrome, tmp_path):
    trial = record_trial(tmp_path / "scenes")
    write_page([trial], tmp_path / "page.html", photos=None, scores=None)
    chrome.open(tmp_path / "page.html")
    assert chrome.js("document.getElementById('in3d').textContent") == "there is no scene.glb"
    shutil.copy(EXAMPLES / "chelsea" / "scene.glb", trial.folder / "scene.glb")
    write_page([trial], tmp_path / "page.html", photos=None, scores=None)
    chrome.said.clear()
    chrome.open(tmp_path / "page.html")
    chrome.until("document.querySelector('#in3d[data-ready]')")
    drawn = "document.querySelector('#in3d canvas').toDataURL()"
    before = chrome.js(drawn)
    chrome.page.locator("#in3d canvas").focus()
    chrome.key("ArrowRight")
    assert chrome.js(drawn) != before
    assert chrome.said == []


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
def test_axe_finds_nothing_and_nothing_sticks_out(chrome, page, width):
    if not AXE.is_file():
        pytest.skip("axe-core is not installed: run npm ci in tools/page")
    chrome.resize(width)
    chrome.open(page)
    chrome.page.evaluate(AXE.read_text(encoding="utf-8"))
    for scheme in ("dark", "light"):
        chrome.prefer(scheme)
        result = chrome.js("axe.run(document, { resultTypes: ['violations'] })")
        found = [(v["id"], [n["html"][:160] for n in v["nodes"]]) for v in result["violations"]]
        assert found == [], scheme
        assert chrome.js("document.documentElement.scrollWidth") <= width


def test_pairs_name_the_pictures_that_were_scored(tmp_path, capsys):
    trial = record_trial(tmp_path / "scenes")
    score_trial(tmp_path / "scores", trial)
    lines = tmp_path / "pairs.jsonl"
    asked = ["trajectory", "pairs", str(tmp_path / "scenes"), "-o", str(lines)]
    asked += ["--scores", str(tmp_path / "scores"), "--seed", "1"]
    assert cli.run([*asked, "--json"]) == 0
    pairs = json.loads(capsys.readouterr().out)["pairs"]
    assert pairs == [json.loads(line) for line in lines.read_text().splitlines()]
    # Checkpoints 1, 2, 3 and 5: the fourth has no camera, and the submission is the last.
    assert Counter(pair["gap"] for pair in pairs) == {"1-2": 5, "3-5": 1}
    places = {
        name: place for p in pairs for name, place in zip(p["shown"], p["renders"], strict=True)
    }
    slot = slot_folder(tmp_path / "scores", trial, 2).parent.relative_to(tmp_path / "scores")
    assert places["3"] == f"{slot.as_posix()}/run/render/room.png"
    assert slot_folder(tmp_path / "scores", trial, None).parent.name == "final"
    assert cli.run(asked) == 0
    assert "codex, gap 1-2: 5\ncodex, gap 3-5: 1\n" in capsys.readouterr().out
    record_trial(tmp_path / "others", tokens=False)
    about = tmp_path / "others" / "room" / "reconstruction.json"
    about.write_text(about.read_text().replace('"agent": "codex"', '"agent": "else"'))
    asked[2] = str(tmp_path / "others")
    assert cli.run(asked) == 2
    assert "is not below SCENES" in capsys.readouterr().err


def test_an_address_that_names_no_trial_shows_the_first(chrome, tmp_path):
    """%E0%A4%A is half a character."""
    record_trial(tmp_path / "scenes")
    page = tmp_path / "page.html"
    assert cli.run(["trajectory", "report", str(tmp_path / "scenes"), "-o", str(page)]) == 0
    for address in ("#%E0%A4%A", "#another", "#room"):
        chrome.open(page, address)
        chrome.until("location.hash === '#room'")
    assert chrome.said == []
