"""The section of normals: coded arrays, a list of photos, and panes under one cursor."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
from evaluation.normals.folders import evaluate, wall, write_run, write_truth
from report.chromium import browser
from report.pages import Tables, document_of, page_of

from legoworld.evaluation.pixels.resampling import decode_array
from legoworld.records import base as record
from legoworld.records.normals import NormalsView
from legoworld.report.normals_images import NO_ERROR, normals_drawing

SIZE = (40, 30)


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory):
    """A wall that is 20 degrees off with many holes, and a photo that failed."""
    folder = tmp_path_factory.mktemp("normals")
    predicted = wall(SIZE, 20)
    predicted[:10] = np.nan
    truth = {name: wall(SIZE) for name in ("a.png", "b.png")}
    truth["a.png"][-1] = 0
    run = write_run(folder / "run", {"a.png": predicted, "b.png": np.empty(0)})
    evaluate(run, write_truth(folder / "truth", truth), folder / "eval")
    return folder / "eval"


def test_codes_are_the_vectors_and_their_angles(evaluation):
    view = record.decode(NormalsView, (evaluation / "view" / "1.json").read_bytes())
    drawn = normals_drawing([None, view])
    assert (drawn.size_wh, drawn.image_wh) == (SIZE, SIZE)
    assert drawn.predicted[0] is drawn.errors[0] is None
    codes = np.frombuffer(base64.b64decode(drawn.predicted[1]), np.int8).reshape(30, 40, 3)
    exact = decode_array(view.predicted, view.size_wh, 3)
    assert not codes[:10].any()
    assert np.abs(codes[10:] / 127 - exact[10:]).max() <= 0.5 / 127 + 1e-6
    errors = np.frombuffer(base64.b64decode(drawn.errors[1]), "<u2").reshape(30, 40)
    assert np.all(errors[10:-1] == 2000)
    assert np.all(errors[:10] == NO_ERROR)
    assert np.all(errors[-1] == NO_ERROR)
    assert drawn.error_deg == pytest.approx(20, abs=1e-4)
    assert normals_drawing([None]) is None


def test_photos_are_listed_by_their_mean_error_with_advice(evaluation, tmp_path):
    rows = {row[0]: row for row in Tables(page_of(tmp_path / "r.html", evaluation)).rows if row}
    mean = json.loads((evaluation / "per_image.jsonl").read_text().splitlines()[0])["metrics"]
    shown = f"{mean['mean_deg']['error_90']:.4f}"
    assert rows["a.png"][1:5] == [str(29 * 40), "ok", shown, "34.5 %"]
    assert rows["b.png"][2:5] == ["invalid", "-", "-"]
    assert rows["photo"][3:5] == ["mean error", "holes"]
    said = {view.id: view.sides[0] for view in document_of(evaluation).views}
    assert "34.5% of the measured pixels have no normal" in said[1].advice[0].what
    assert dict(said[1].facts)["mean_deg"].startswith(f"error_90 {shown}, exclude 20.0000")


def test_panes_show_vectors_and_errors_under_one_cursor(evaluation, tmp_path):
    page = page_of(tmp_path / "r.html", evaluation)
    with browser(viewport={"width": 1280, "height": 900}) as chrome:
        chrome.open(page, "#/normals/1")
        chrome.until("document.querySelectorAll('.pane').length === 3")
        box = chrome.js(
            "JSON.parse(JSON.stringify(document.querySelector('.frame').getBoundingClientRect()))"
        )
        chrome.move_mouse(box["x"] + box["width"] * 20.5 / 40, box["y"] + box["height"] / 2)
        text = chrome.js("document.querySelector('.readout').textContent")
        assert text == (
            "near x 20, y 15: ground truth (0.00, 0.00, -1.00); "
            "scene (0.34, 0.00, -0.94), off 20.0°"
        )
        assert chrome.said == []
