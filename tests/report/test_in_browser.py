"""The page in a real browser, opened from the disk. Skips where no Chromium is installed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from evaluation.depth.folders import plane, write_arrays, write_run
from evaluation.detection_runs import random_predictions, random_truth
from report.chromium import Browser, browser
from report.pages import HOSTILE, document_of, evaluated, page_of, write_photos, written

from legoworld import cli
from legoworld.evaluation.depth.evaluate import evaluate_depth
from legoworld.evaluation.detection.inputs.masks import areas_px, compressed
from legoworld.report import page_file

LISTED = (
    "Array.from(document.querySelectorAll('section:not([hidden]) [data-table=photos] tbody tr'))"
)
OVERHANG = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
SHOWN = f"{LISTED}.filter(r => !r.hidden).map(r => r.dataset.image)"


@pytest.fixture(scope="module")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        opened.resize(1280)
        yield opened


@pytest.fixture(autouse=True)
def _no_complaints(chrome: Browser) -> Iterator[None]:
    """No test may leave an error, a warning or a refused request in the console."""
    chrome.said.clear()
    yield
    assert chrome.said == []


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Boxes with hostile names, masks of two sides, and depth, with photos."""
    folder = tmp_path_factory.mktemp("page")
    truth = {"a.png": plane((80, 60))}
    run = write_run(folder / "run", {"a.png": 1.5 * truth["a.png"]})  # type: ignore[dict-item]
    evaluate_depth(run, write_arrays(folder / "truth", truth), folder / "depth", draws=5)
    lvis = [
        evaluated(folder, "lvis", statuses={10: "failed"}),
        evaluated(folder, "lvis", levels=None, kind="baseline", baseline="random"),
    ]
    boxes = evaluated(folder, "coco", hostile=True)
    photos = write_photos(folder / "photos", "coco")
    return page_of(folder / "report.html", boxes, *lvis, folder / "depth", photos=photos)


def click(chrome: Browser, selector: str) -> None:
    chrome.js(f"document.querySelector({json.dumps(selector)}).click()")


def choose(chrome: Browser, name: str, value: str) -> None:
    chrome.js(
        f"(() => {{ const i = document.querySelector('section:not([hidden]) [data-filter={name}]');"
        f" i.value = {json.dumps(value)}; i.dispatchEvent(new Event('input')); }})()"
    )


def test_it_opens_from_the_disk_and_asks_for_nothing(chrome: Browser, page: Path) -> None:
    chrome.open(page)
    assert chrome.js("location.protocol") == "file:"
    assert chrome.js("performance.getEntriesByType('resource').map(e => e.name)") == []
    policy = "document.querySelector('meta[http-equiv]').content"
    assert chrome.js(policy).startswith("default-src 'none'")
    assert chrome.js("document.querySelectorAll('section.task:not([hidden])').length") == 1
    assert chrome.js(OVERHANG) == 0


def test_names_from_scenes_stay_text(chrome: Browser, page: Path) -> None:
    chrome.js("0")
    for hash_text in ("#/coco", "#/coco/10"):
        chrome.open(page, hash_text)
        assert chrome.js("document.querySelectorAll('img[src=x]').length") == 0
        assert HOSTILE.replace("\u2028", "") in chrome.js("document.body.textContent").replace(
            "\u2028", ""
        )


def test_sorting_turns_and_ends_as_it_was(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco")
    before = chrome.js(SHOWN)
    by_file = sorted(before, key=int)
    button = "section:not([hidden]) [data-table=photos] [data-sort=file]"
    click(chrome, button)
    assert chrome.js(SHOWN) == by_file
    assert "sort=file" in chrome.js("location.hash")
    click(chrome, button)
    assert chrome.js(SHOWN) == by_file[::-1]
    click(chrome, button)
    assert chrome.js(SHOWN) == before
    assert chrome.js("location.hash") == "#/coco"


def test_numbers_sort_as_numbers_and_gaps_come_last(chrome: Browser, page: Path) -> None:
    values = f"{LISTED}.map(r => r.querySelector('[data-key=pq0]').dataset.v)"
    for order in ("pq0", "-pq0"):
        chrome.open(page, f"#/coco?sort={order}")
        found = chrome.js(values)
        known = [float(v) for v in found if v]
        assert known == sorted(known, reverse=order[0] == "-")
        assert "" not in found[: len(known)]


def test_filters_are_in_the_address_and_the_address_filters(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/lvis")
    everything = chrome.js(SHOWN)
    choose(chrome, "status", "failed")
    assert chrome.js(SHOWN) == ["10"]
    choose(chrome, "status", "")
    choose(chrome, "kind", "classification")
    some = chrome.js(SHOWN)
    assert 0 < len(some) < len(everything)
    address = chrome.js("location.hash")
    chrome.open(page, address)
    assert chrome.js(SHOWN) == some
    count = chrome.js(
        "document.querySelector('section:not([hidden]) [data-count=photos]').textContent"
    )
    assert count == f"{len(some)} of {len(everything)} photos"


def test_an_error_s_link_lists_its_photos(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco")
    n = int(chrome.js("document.querySelectorAll('.errors tbody tr')[1].cells[2].textContent"))
    click(chrome, ".errors a[href='#/coco?kind=localisation']")
    assert len(chrome.js(SHOWN)) == n > 0


def test_a_link_opens_a_photo_and_keys_walk_the_list(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco?sort=file")
    order = chrome.js(SHOWN)
    chrome.open(page, f"#/coco/{order[3]}?sort=file")
    assert chrome.js("document.querySelector('#detail h2').textContent") == "003.jpg"
    chrome.key("ArrowRight")
    assert chrome.js("location.hash") == f"#/coco/{order[4]}?sort=file"
    chrome.key("ArrowLeft")
    chrome.key("ArrowLeft")
    assert chrome.js("location.hash") == f"#/coco/{order[2]}?sort=file"
    chrome.key("Escape")
    assert chrome.js("document.querySelector('#overview').hidden") is False
    assert chrome.js(f"{LISTED}.find(r => r.classList.contains('here')).dataset.image") == order[2]
    chrome.js("history.back()")
    chrome.until("!document.querySelector('#detail').hidden")
    assert chrome.js("location.hash") == f"#/coco/{order[2]}?sort=file"


def test_a_photo_that_is_not_there_is_said(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco/99999")
    assert "No photo 99999" in chrome.js("document.querySelector('#detail').textContent")


def test_boxes_are_drawn_where_they_are(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco/10")
    drawn = chrome.js(
        "Array.from(document.querySelectorAll('.stage .s-tp .line')).map(p => p.getAttribute('d'))"
    )
    view = json.loads(chrome.js("document.getElementById('view-0').textContent"))
    found = [p["box"] for p in view["sides"][0]["predictions"] if p["o"] == "tp"]
    assert found
    assert sorted(drawn) == sorted(f"M{x} {y}h{w}v{h}h{-w}Z" for x, y, w, h in found)
    assert chrome.js("document.querySelector('.stage svg').getAttribute('viewBox')") == "0 0 120 90"
    loaded = "document.querySelector('.stage image').href.baseVal.slice(0, 22)"
    assert chrome.js(loaded) == "data:image/webp;base64"


def test_layers_switch_and_are_in_the_address(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/lvis/13")
    assert chrome.js("document.querySelectorAll('.stage .side-1').length") == 0
    click(chrome, "[data-layer=fp1]")
    assert chrome.js("document.querySelectorAll('.stage .s-fp.side-1').length") > 0
    click(chrome, "[data-layer=truth]")
    assert chrome.js("document.querySelectorAll('.stage .s-truth').length") == 0
    address = chrome.js("location.hash")
    chrome.open(page, address)
    assert chrome.js("document.querySelectorAll('.stage .s-fp.side-1').length") > 0
    assert chrome.js("document.querySelectorAll('.stage .s-truth').length") == 0


def test_masks_are_outlined_along_their_pixels(chrome: Browser, tmp_path: Path) -> None:
    """Painted by the browser, an outline fills exactly the pixels of its mask."""
    random = np.random.default_rng(0)
    truth = random_truth("lvis", seed=3, images=1)
    shapes = [random.random((90, 120)) < share for share in (0.02, 0.5, 0.9)]
    shapes.append(cv2.circle(np.zeros((90, 120), np.uint8), (60, 45), 30, 1, 7) > 0)
    masks = [compressed(rle_of(m), (90, 120)) for m in shapes]
    assert areas_px(masks).tolist() == [m.sum() for m in shapes]
    ids = [c["id"] for c in truth["categories"]]
    predictions = [
        {
            "image_id": truth["images"][0]["id"],
            "category_id": ids[k],
            "segmentation": {"size": [90, 120], "counts": m["counts"].decode()},
            "score": 1.0,
        }
        for k, m in enumerate(masks)
    ]
    truth["images"][0]["neg_category_ids"] = ids
    page = page_of(
        tmp_path / "r.html", evaluated(tmp_path, "lvis", truth=truth, predictions=predictions)
    )
    chrome.open(page, f"#/lvis/{truth['images'][0]['id']}?show=tp0.fp0.other0")
    painted = chrome.js(
        """Array.from(document.querySelectorAll('.stage .line')).map(path => {
          const canvas = document.createElement('canvas');
          canvas.width = 120; canvas.height = 90;
          const context = canvas.getContext('2d');
          context.fill(new Path2D(path.getAttribute('d')), 'evenodd');
          const data = context.getImageData(0, 0, 120, 90).data;
          return Array.from({length: 90 * 120}, (_, i) => data[4 * i + 3]);
        })"""
    )
    found = {np.array(p).reshape(90, 120).tobytes() for p in painted}
    assert found == {(m * 255).astype(np.int64).tobytes() for m in shapes}


def rle_of(mask: np.ndarray) -> dict:
    """Uncompressed run lengths, column by column."""
    flat = mask.ravel(order="F")
    edges = np.flatnonzero(np.diff(flat.astype(int))) + 1
    runs = np.diff(np.concatenate([[0], edges, [flat.size]])).tolist()
    return {"size": list(mask.shape), "counts": ([0] if flat[0] else []) + runs}


def test_depth_under_the_cursor(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/eth3d/1")
    places = "Array.from(document.querySelectorAll('.pane canvas')).map(c => [c.width, c.height])"
    assert chrome.js(places) == [[80, 60]] * 3
    box = chrome.js(
        "JSON.parse(JSON.stringify(document.querySelector('.pane').getBoundingClientRect()))"
    )
    chrome.move_mouse(box["x"] + box["width"] * 20.5 / 80, box["y"] + box["height"] * 30.5 / 60)
    text = chrome.js("document.querySelector('.readout').textContent")
    z = plane((80, 60))[30, 20]
    assert text.startswith(f"near x 20, y 30: truth {z:.3f} m; scene {z:.3f} m, off")
    assert chrome.js("Array.from(document.querySelectorAll('.cross')).every(c => !c.hidden)")
    ticks = chrome.js(
        "Array.from(document.querySelectorAll('.ticks span')).map(t => t.textContent)"
    )
    assert len(ticks) == 10
    assert all(t.endswith(" m") for t in ticks)


@pytest.mark.parametrize("hash_text", ["#/coco", "#/coco/10", "#/lvis/13", "#/eth3d/1"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_narrow_dark_and_light(chrome: Browser, page: Path, hash_text: str, scheme: str) -> None:
    chrome.prefer(scheme)
    for width in (400, 1280):
        chrome.resize(width)
        chrome.open(page, hash_text)
        assert chrome.js(OVERHANG) == 0
    ground = chrome.js("getComputedStyle(document.body).backgroundColor")
    light = int(ground.strip("rgb()").split(",")[0])
    assert (light > 200) == (scheme == "light")
    chrome.prefer("light")


def test_it_prints_every_section(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco")
    chrome.call("Emulation.setEmulatedMedia", media="print")
    assert chrome.js("document.querySelector('[data-section=lvis]').offsetHeight") > 100
    assert chrome.js("getComputedStyle(document.querySelector('.tools')).display") == "none"
    assert len(chrome.pdf()) > 10_000
    chrome.call("Emulation.setEmulatedMedia", media="")


def test_views_beside_the_page_are_loaded_from_the_disk(
    chrome: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_file, "EMBEDDED_VIEWS", 3)
    photos = write_photos(tmp_path / "photos", "coco")
    page = written(document_of(evaluated(tmp_path, "coco"), photos=photos), tmp_path / "r.html")
    chrome.open(page, "#/coco/13?sort=file")
    chrome.until("document.querySelector('.stage image')")
    chrome.key("ArrowRight")
    chrome.until("document.querySelector('#detail h2').textContent !== '001.jpg'")
    assert (
        chrome.js(
            "(async () => { const i = new Image(); "
            "i.src = document.querySelector('.stage image').href.baseVal; await i.decode(); "
            "return i.naturalWidth; })()"
        )
        == 120
    )


def test_a_comparison_without_its_evaluations_still_opens(chrome: Browser, tmp_path: Path) -> None:
    sides = [
        evaluated(tmp_path, "coco"),
        evaluated(tmp_path, "coco", kind="baseline", baseline="random"),
    ]
    folder = tmp_path / "comparison"
    assert cli.run(["compare", *map(str, sides), "-o", str(folder), "--draws", "20"]) == 0
    for side in sides:
        shutil.rmtree(side)
    chrome.open(page_of(tmp_path / "r.html", folder), "#/coco/10")
    chrome.key("ArrowRight")
    chrome.key("Escape")
    assert chrome.js("document.querySelectorAll('.compared tbody tr').length") > 20
    assert chrome.js(OVERHANG) == 0


def test_views_that_were_left_behind_are_said(
    chrome: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_file, "EMBEDDED_VIEWS", 3)
    page = written(document_of(evaluated(tmp_path, "coco")), tmp_path / "r.html")
    (tmp_path / "r_files" / "view-000001.js").unlink()
    chrome.open(page, "#/coco/13")
    chrome.until(
        "document.querySelector('#detail').textContent.includes('keep the folder r_files')"
    )
    assert len(chrome.said) == 1
    chrome.said.clear()


def test_five_hundred_photos_stay_responsive(chrome: Browser, tmp_path: Path) -> None:
    """Against the browser's own cost of moving as many rows: a slow machine is no failure."""
    truth = random_truth("coco", seed=5, images=500)
    predictions = random_predictions("coco", truth, seed=5, per_image=5, levels=1)
    evaluation = evaluated(tmp_path, "coco", truth=truth, predictions=predictions)
    chrome.open(page_of(tmp_path / "r.html", evaluation))
    assert len(chrome.js(SHOWN)) == 500
    times = chrome.js(
        """(() => {
          const table = document.querySelector('[data-table=photos]'), body = table.tBodies[0];
          const input = document.querySelector('[data-filter=q]');
          const button = table.querySelector('[data-sort=pq0]');
          const timed = act => { const start = performance.now(); act(); body.offsetHeight;
            return performance.now() - start; };
          const type = text => { input.value = text; input.dispatchEvent(new Event('input')); };
          const rounds = Array.from({length: 5}, (_, k) => [
            timed(() => body.append(...Array.from(body.rows).reverse())),
            timed(() => type('1' + k)), timed(() => type('')), timed(() => button.click())]);
          return rounds[0].map((_, i) => Math.min(...rounds.map(r => r[i])));
        })()"""
    )
    moved, filtered, cleared, sorted_again = times
    assert max(filtered, cleared, sorted_again) < 6 * moved + 50, times
