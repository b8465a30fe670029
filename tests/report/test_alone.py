"""A page of one photo: its view in every task, and no word of the others."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from evaluation.detection_runs import random_predictions, random_truth
from report.bench_pages import bench_dataset, bench_evaluation, troubled_submissions
from report.chromium import Browser, browser
from report.pages import evaluate, write_photos

import legoworld
from legoworld import cli
from legoworld.errors import UsageError


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    with browser(viewport={"width": 390, "height": 844}) as opened:
        yield opened


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A detector's boxes and masks on the same photos, with their page."""
    folder = tmp_path_factory.mktemp("alone")
    for task in ("coco", "coco-masks"):
        truth = random_truth(task, seed=3, images=8)
        answers = random_predictions(task, truth, seed=3, levels=None)
        evaluate(folder, task, truth=truth, predictions=answers, kind="baseline", baseline="net")
    write_photos(folder / "photos", "coco", seed=3, images=8)
    return folder


def test_one_photo_in_every_task_and_nothing_of_the_others(made: Path, chrome: Browser) -> None:
    sides = [made / f"eval-{task}-net" for task in ("coco", "coco-masks")]
    whole = legoworld.write_report(sides, made / "all.html", photos=made / "photos")
    names = [image["file_name"] for image in random_truth("coco", seed=3, images=8)["images"]]
    name = names[2]
    words = ["report", *map(str, sides), "--photos", str(made / "photos"), "--photo", name]
    assert cli.run([*words, "-o", str(made / "one.html")]) == 0
    text = (made / "one.html").read_text(encoding="utf-8")
    assert text.count('id="photo-') == 1
    assert len(text) < whole.n_bytes
    assert name in text
    assert not any(other in text for other in names if other != name)
    chrome.open(made / "one.html")
    chrome.until("document.querySelector('.pane .shape')")
    counts = "document.querySelector('.scores').textContent"
    alone, place = chrome.js(counts), chrome.js("location.hash")
    chrome.key("Escape")  # there is no list to go back to
    assert chrome.js(counts) == alone
    links = "Array.from(document.querySelectorAll('a'), (a) => a.getAttribute('href'))"
    assert [link.partition("/")[0] for link in chrome.js(links)] == ["#"]
    chrome.js("document.querySelector('[data-other=coco-masks] summary').click()")
    chrome.until("document.querySelector('[data-other=coco-masks] .pane .shape')")
    chrome.open(made / "all.html", place)
    chrome.until("document.querySelector('.pane .shape')")
    assert chrome.js(counts) == alone, "as the whole page counts at the same confidence"


def test_a_case_of_the_bench(tmp_path: Path, chrome: Browser) -> None:
    dataset = bench_dataset(tmp_path)
    evaluation = bench_evaluation(tmp_path, dataset, "agent", troubled_submissions(dataset))
    whole = legoworld.write_report([evaluation], tmp_path / "all.html")
    case = json.loads((evaluation / "per_image.jsonl").read_text().splitlines()[3])["file_name"]
    one = legoworld.write_report([evaluation], tmp_path / "one.html", photo=case)
    assert one.views == 1
    assert one.n_bytes < whole.n_bytes
    chrome.open(one.path)
    chrome.until("document.querySelector('.pane svg image')")


def test_a_photo_that_is_not_there(made: Path) -> None:
    with pytest.raises(UsageError, match="no photo of this page"):
        legoworld.write_report([made / "eval-coco-net"], made / "none.html", photo="nowhere.jpg")


def test_it_links_to_no_trials(made: Path) -> None:
    with pytest.raises(UsageError, match="links nowhere"):
        legoworld.write_report(
            [made / "eval-coco-net"], made / "none.html", photo="1.jpg", trials=made / "t.html"
        )
