"""Every planted fault is named on the first screen of its page, with its size, a click away."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from report.chromium import browser
from report.pages import evaluate, page_of
from report.planted.plant import Plant, Planted, check
from report.planted.table import PLANTS

#: No seed that anything was developed with; `python -m report.planted` draws others.
SEED = 20261126


@pytest.mark.parametrize("plant", PLANTS, ids=lambda p: p.id)
def test_a_planted_fault_is_named_with_its_size(plant: Plant, tmp_path: Path) -> None:
    check(plant.make(tmp_path, np.random.default_rng((SEED, PLANTS.index(plant)))))


def test_in_a_browser_the_first_line_leads_to_the_photos_that_it_names(tmp_path: Path) -> None:
    plant = next(plant for plant in PLANTS if plant.id == "coco: confused class")
    planted = plant.make(tmp_path, np.random.default_rng(SEED))
    page = page_of(tmp_path / "r.html", *planted.evaluations)
    with browser(viewport={"width": 1400, "height": 900}) as chrome:
        chrome.open(page)
        line = "document.querySelector('.costs li a')"
        chrome.until(f"{line} !== null && {line}.getBoundingClientRect().bottom < 900")
        said = chrome.js(f"{line}.textContent")
        assert all(words in said for words in (*planted.says, f"{planted.size:+.3f}"))
        assert "AP over all 14 images" in chrome.js(
            "document.querySelector('.costs p.over').textContent"
        )
        chrome.js(f"{line}.click()")
        cards = "document.querySelectorAll('[data-gallery] .card')"
        chrome.until(f"{cards}.length === {len(planted.images)}")
        assert chrome.said == []


@pytest.mark.real_data
def test_a_class_confused_by_a_real_detector_is_what_costs_most(
    real_data: Path, tmp_path: Path
) -> None:
    truth = json.loads((real_data / "coco/instances_val2017_188.json").read_text())
    results = json.loads((real_data / "coco/yolox_nano_val2017_188_results.json").read_text())
    names = {c["name"]: c["id"] for c in truth["categories"]}
    for one in results:
        if one["category_id"] == names["dog"]:
            one["category_id"] = names["person"]
    before = json.loads((real_data / "coco/yolox_nano_val2017_188_results.json").read_text())
    gains = [evaluate(tmp_path / str(k), "coco", truth=truth, predictions=some, kind="baseline",
                       baseline="yolox") for k, some in enumerate((results, before))]  # fmt: skip
    bad, good = (json.loads((g / "summary.json").read_text())["metrics"]["AP"] for g in gains)
    seen = {a["image_id"] for a in truth["annotations"] if a["category_id"] == names["dog"]}
    found = {r["image_id"] for r in before if r["category_id"] == names["dog"]} & seen
    check(
        Planted(
            evaluations=(gains[0],), kind="classification", says=("dog",), size=good - bad,
            within=0.3 * (good - bad), images=frozenset(sorted(found)[:1]),
        )
    )  # fmt: skip
