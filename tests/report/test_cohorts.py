"""A selection of photos scored in the page: the evaluator's own numbers on the same photos."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evaluation.detection_runs import random_predictions, random_truth
from report.chromium import Browser, browser
from report.pages import document_of, evaluate, page_of

from legoworld import cli
from legoworld.evaluation.detection.matching.outcomes import table_from
from legoworld.evaluation.stored import read_evaluation
from legoworld.report.cohorts import cohorts, photo_gains
from legoworld.tables.files import latex
from legoworld.tables.table import table


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    with browser(viewport={"width": 1280, "height": 900}) as opened:
        yield opened


TRUTH = random_truth("coco", seed=7, images=14)
ANSWERS = random_predictions("coco", TRUTH, seed=7, levels=None)
#: Of the side: every character that LaTeX reads.
NAME = r"r_50 & 5 % ~^\{x} #$ ↓"
#: Filters of the address, and what they select: part of a photo's name, a category, a size.
SELECTIONS = [
    ("q=1", "1", None, ""),
    (f"cat={TRUTH['categories'][0]['id']}", "", TRUTH["categories"][0]["id"], ""),
    ("size=medium", "", None, "m"),
]


def numbers(chrome: Browser) -> dict[str, float]:
    """What the page says of the selection, in full."""
    chrome.until("document.querySelector('[data-cohort] [data-number=recall]')")
    return dict(
        chrome.js(
            """Array.from(document.querySelectorAll('[data-cohort] [data-number]'),
            n => [n.dataset.number, Number(n.dataset.value)])"""
        )
    )


def evaluated_part(folder: Path, ids: set[int], category: int | None) -> tuple[Any, Any]:
    """summary.json and the rows of the same predictions over some photos, by the evaluator."""
    kept = [a for a in TRUTH["annotations"] if a["image_id"] in ids]
    truth = {**TRUTH, "images": [i for i in TRUTH["images"] if i["id"] in ids]}
    answers = [p for p in ANSWERS if p["image_id"] in ids]
    if category is not None:
        truth["categories"] = [c for c in TRUTH["categories"] if c["id"] == category]
        kept = [a for a in kept if a["category_id"] == category]
        answers = [p for p in answers if p["category_id"] == category]
    one = evaluate(folder, "coco", truth={**truth, "annotations": kept}, predictions=answers)
    lines = (one / "per_image.jsonl").read_text().splitlines()
    return json.loads((one / "summary.json").read_text()), [json.loads(line) for line in lines]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cohorts")
    boxes = evaluate(folder, "coco", truth=TRUTH, predictions=ANSWERS, kind="baseline",
                      baseline=NAME)  # fmt: skip
    return page_of(folder / "report.html", boxes)


@pytest.mark.parametrize(("address", "name", "category", "size"), SELECTIONS)
def test_the_page_scores_a_selection_as_the_evaluator_does(
    chrome: Browser, page: Path, tmp_path: Path, address: str, name: str, category: int | None,
    size: str,
) -> None:  # fmt: skip
    chrome.open(page, f"#/coco?tab=photos&conf=0&{address}")
    said = numbers(chrome)
    with chrome.page.expect_download() as saving:
        chrome.page.get_by_text("save as a track").click()
    track = json.loads(Path(saving.value.path()).read_text())
    assert track["info"] == {"task": "coco"}
    assert [c["id"] for c in track["categories"]] == sorted(c["id"] for c in TRUTH["categories"])
    chosen = {i["id"]: i for i in track["images"]}
    assert 0 < len(chosen) < 14 or size
    assert all(name in i["file_name"] for i in track["images"])
    by_id = {i["id"]: i for i in TRUTH["images"]}
    assert all(by_id[k]["width"] == i["width"] for k, i in chosen.items())
    summary, rows = evaluated_part(tmp_path, set(chosen), category)
    assert said["AP"] == pytest.approx(summary["metrics"][f"AP{size}"], abs=1e-12)
    if not size:
        tp, fp = (sum(row["greedy_50"][key] for row in rows) for key in ("tp", "fp"))
        objects = summary["counts"]["areas"]["all"]["truth_instances"]
        assert said["AP50"] == pytest.approx(summary["metrics"]["AP50"], abs=1e-12)
        assert said["precision"] == pytest.approx(tp / (tp + fp))
        assert said["recall"] == pytest.approx(tp / objects)


def test_a_tag_selects_its_photos_and_scores_them(chrome: Browser, tmp_path: Path) -> None:
    names = {i["id"]: i["file_name"] for i in TRUTH["images"]}
    night = set(list(names)[:5])
    tags = tmp_path / "tags.csv"
    lines = [f"{names[i]},night,me" for i in night] + [f"{n},day" for n in names.values()]
    tags.write_text("\ufefffile_name,tag,by\n" + "\n".join([*lines, "other.jpg,night"]) + "\n")
    boxes = evaluate(tmp_path, "coco", truth=TRUTH, predictions=ANSWERS)
    page = tmp_path / "tagged.html"
    assert cli.run(["report", str(boxes), "--tags", str(tags), "-o", str(page)]) == 0
    chrome.open(page, "#/coco?tab=photos")
    chrome.page.locator("[data-filter=tag]").select_option(label="night (5)")
    chrome.until("location.hash.includes('tag=night')")
    chrome.until(
        "document.querySelector('[data-cohort]').textContent.includes('5 photos, tag night')"
    )
    summary, _ = evaluated_part(tmp_path, night, None)
    assert numbers(chrome)["AP"] == pytest.approx(summary["metrics"]["AP"], abs=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name,tag\na.jpg,x\n", "the columns name, tag"),
        ("", "the columns none"),
        ("file_name,tag\na.jpg\n", "line 2 without a name or a tag"),
        ('file_name,tag\n"a.jpg,x\n', "unexpected end of data"),
        ("file_name,tag\nunknown.jpg,x\n", "unknown.jpg"),
        ("file_name,tag\n", "no line"),
    ],
)
def test_tags_that_cannot_be_used_are_refused(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text(text)
    boxes = evaluate(tmp_path, "coco", truth=TRUTH, predictions=ANSWERS)
    page = tmp_path / "page.html"
    assert cli.run(["report", str(boxes), "--tags", str(tags), "-o", str(page)]) == 2
    assert said in capsys.readouterr().err
    assert not page.exists()


def test_confidence_counts_and_draws_what_is_above_it(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco?tab=photos&conf=0")
    everything = numbers(chrome)
    slider = chrome.page.locator("[data-panel=photos] [data-confidence] input")
    slider.focus()
    for _ in range(10):
        chrome.key("ArrowRight")
    chrome.until("location.hash.includes('conf=0.5')")
    above = [p for p in ANSWERS if p["score"] >= 0.5]
    said = f"0.50 or above: {len(above)} of {len(ANSWERS)} predictions"
    chrome.until(f"document.querySelector('[data-confidence]').textContent.includes('{said}')")
    chrome.until("document.querySelector('[data-cohort]').textContent.includes('confidence 0.5')")
    found = numbers(chrome)
    assert found["recall"] < everything["recall"]
    assert found["AP"] == everything["AP"], "AP is over all confidences"
    image = next(i for i in TRUTH["images"] if any(p["image_id"] == i["id"] for p in ANSWERS))
    chrome.open(page, f"#/coco/{image['id']}?conf=0.5&panes=side0")
    chrome.until("document.querySelector('.pane .shape')")
    outlines = ".shape.s-tp, .shape.s-fp, .shape.s-other"
    mine = sum(p["image_id"] == image["id"] for p in above)
    assert chrome.js("document.querySelectorAll('.pane').length") == 1
    assert chrome.js(f"document.querySelectorAll('.pane :is({outlines})').length") == mine
    chrome.open(page, "#/coco?tab=photos")
    assert "0.30 or above" in chrome.js("document.querySelector('[data-confidence]').textContent")


def test_the_first_screen_counts_at_the_usual_confidence_and_decodes_nothing(
    chrome: Browser, page: Path
) -> None:
    """Its cards say what the matches say, which are decoded where another confidence is asked."""
    chrome.page.add_init_script("window.atob = new Proxy(atob, {apply(f, it, [text]) {"
                                "window.decoded = true; return f(text); }})")  # fmt: skip
    marks = "Array.from(document.querySelectorAll('[data-sheet] .marks'), m => m.textContent)"
    chrome.open(page)
    chrome.until("document.querySelector('[data-sheet] .thumb svg')")
    usual = chrome.js(marks)
    assert len(usual) == 12
    assert not chrome.js("window.decoded")
    chrome.open(page, "#/coco?conf=0.35")
    assert chrome.js(marks) != usual
    assert chrome.js("window.decoded")
    sides = [read_evaluation(page.parent / f"eval-coco-{NAME}")]
    whole = cohorts(sides)
    table = table_from(sides[0].matches)
    shown = table.score >= whole.usual
    row = whole.sides[0].above[1 + whole.confidences.index(whole.usual)]
    assert row == tuple(np.bincount(table.category[shown], minlength=len(row)))
    state = table.state[0, whole.half, shown]
    for photo in document_of(*[s.folder for s in sides]).sections[0].images:
        mine = state[table.image_ids[table.image[shown]] == photo.id]
        assert photo.cells[0].sure == (np.sum(mine == 1), np.sum(mine == 0))


def test_what_is_on_screen_is_saved_as_latex(chrome: Browser, page: Path) -> None:
    """As `legoworld compare` writes a table of the same cells."""
    chrome.open(page, "#/coco?tab=photos&conf=0.5&size=medium")
    chrome.until("document.querySelector('[data-cohort]').textContent.includes('confidence 0.5')")
    said = numbers(chrome)
    with chrome.page.expect_download() as saving:
        chrome.page.locator("[data-cohort]").get_by_text("LaTeX").click()
    assert saving.value.suggested_filename == "coco-selection.tex"
    text = Path(saving.value.path()).read_text()
    about, row = text.splitlines()[1].removeprefix("% "), text.splitlines()[6]
    assert all(part in about for part in ("selection", "medium", "confidence 0.5", " photos"))
    cells = [NAME, *row.removesuffix(r" \\").split(" & ")[-7:]]
    assert cells[1].startswith(f"{said['AP']:.3f} [")
    assert cells[3].startswith(f"{said['precision']:.3f} [")
    head = ["system", "AP", "AP50", "precision", "recall", "found", "objects", "false positives"]
    assert text == latex(table(head, [cells], notes=[about]))


def test_a_photo_gains_what_its_mending_gains(tmp_path: Path) -> None:
    """Against the evaluator, over predictions that are perfect on that photo alone."""
    boxes = evaluate(tmp_path, "coco", truth=TRUTH, predictions=ANSWERS)
    gains = photo_gains(read_evaluation(boxes))
    before = json.loads((boxes / "summary.json").read_text())["metrics"]["AP50"]
    for image_id in sorted(gains)[:2]:
        perfect = [
            {"image_id": image_id, "category_id": a["category_id"], "bbox": a["bbox"], "score": 1.0}
            for a in TRUTH["annotations"]
            if a["image_id"] == image_id and not a["iscrowd"]
        ]
        mended = [p for p in ANSWERS if p["image_id"] != image_id] + perfect
        one = evaluate(tmp_path / str(image_id), "coco", truth=TRUTH, predictions=mended)
        after = json.loads((one / "summary.json").read_text())["metrics"]["AP50"]
        assert gains[image_id] == pytest.approx(after - before, abs=1e-9)
