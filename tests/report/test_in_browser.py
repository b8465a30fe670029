"""The page in a real browser, opened from the disk. Skips where no Chromium is installed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from evaluation.depth.folders import evaluate_depth, plane, write_arrays, write_run
from evaluation.detection_runs import random_predictions, random_truth
from report.chromium import Browser, browser
from report.pages import (
    HOSTILE,
    document_of,
    embedded_json,
    evaluate,
    page_of,
    write,
    write_photos,
)

from legoworld import cli
from legoworld.evaluation.detection.inputs.masks import areas_px, compress_mask
from legoworld.report import page_file

OVERHANG = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
SECTION = "section.task:not([hidden])"
#: The cards of the gallery that exist now, in its order.
CARDS = f"Array.from(document.querySelectorAll('{SECTION} [data-gallery] a.card'))"
SHOWN = f"{CARDS}.map(a => a.dataset.image)"
COUNT = f"document.querySelector('{SECTION} [data-count=photos]').textContent"


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    with browser(viewport={"width": 1280, "height": 900}) as opened:
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
        evaluate(folder, "lvis", statuses={10: "failed"}),
        evaluate(folder, "lvis", levels=None, kind="baseline", baseline="random"),
    ]
    boxes = evaluate(folder, "coco", hostile=True)
    photos = write_photos(folder / "photos", "coco")
    return page_of(folder / "report.html", boxes, *lvis, folder / "depth", photos=photos)


def click(chrome: Browser, selector: str) -> None:
    chrome.js(f"document.querySelector({json.dumps(selector)}).click()")


def choose(chrome: Browser, name: str, value: str) -> None:
    chrome.js(
        f"(() => {{ const i = document.querySelector('{SECTION} [data-filter={name}]');"
        f" i.value = {json.dumps(value)}; i.dispatchEvent(new Event('input')); }})()"
    )


def test_it_opens_from_the_disk_and_asks_for_nothing(chrome: Browser, page: Path) -> None:
    chrome.open(page)
    assert chrome.js("location.protocol") == "file:"
    assert [url for url in chrome.asked if not url.startswith("data:")] == [page.as_uri()]
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


def test_a_photo_shows_what_other_tasks_say_of_it(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco/13")
    chrome.until("!document.querySelector('#detail').hidden")
    others = "Array.from(document.querySelectorAll('#detail .other-task'))"
    assert chrome.js(f"{others}.map(d => d.dataset.other)") == ["lvis"]
    assert "random 1 of 1" in chrome.js("document.querySelector('.other-task summary').textContent")
    assert chrome.js("document.querySelectorAll('.other-task .stage').length") == 0
    click(chrome, ".other-task summary")
    chrome.until("document.querySelector('.other-task .stage svg.frame')")
    address = chrome.js("location.hash")
    click(chrome, ".other-task [data-pane]")
    assert chrome.js("location.hash") == address, "its switches are not the photo's"
    assert chrome.js(OVERHANG) == 0
    click(chrome, ".other-task summary a")
    chrome.until("location.hash === '#/lvis/13'")
    chrome.until("document.querySelector('.other-task').dataset.other === 'coco'")
    chrome.open(page, "#/eth3d/1")
    chrome.until("!document.querySelector('#detail').hidden")
    assert chrome.js(f"{others}.length") == 0


def test_all_tasks_stand_in_one_table_with_their_denominators(chrome: Browser, page: Path) -> None:
    chrome.open(page)
    rows = chrome.js(
        "Array.from(document.querySelectorAll('.all-tasks tbody tr')).map(r => r.textContent)"
    )
    assert len(rows) == 4  # boxes, two sides of masks, depth
    assert "COCO boxes" in rows[0]
    assert "11 of 12" in rows[1]
    assert "lvis" in rows[1]
    click(chrome, ".all-tasks tbody tr:last-child a")
    chrome.until("location.hash.startsWith('#/eth3d')")


def test_the_gallery_sorts_as_the_address_says(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco?tab=photos")
    before = chrome.js(SHOWN)
    assert len(before) == 12
    choose(chrome, "sort", "file")
    assert chrome.js(SHOWN) == sorted(before, key=int)
    assert "sort=file" in chrome.js("location.hash")
    choose(chrome, "sort", "")
    assert chrome.js(SHOWN) == before
    assert chrome.js("location.hash") == "#/coco?tab=photos"


def test_numbers_sort_as_numbers_and_gaps_come_last(chrome: Browser, page: Path) -> None:
    (data,) = embedded_json(page, "data")
    rows = {str(r["id"]): r["cells"][1]["quality"] for r in data["sections"][1]["images"]}
    for order, falling in (("q1", False), ("-q1", True)):
        chrome.open(page, f"#/lvis?tab=photos&sort={order}")
        values = [rows[i] for i in chrome.js(SHOWN)]
        known = [v for v in values if v is not None]
        assert known == sorted(known, reverse=falling)
        assert values[len(known) :] == [None] * (len(values) - len(known))


def test_filters_are_in_the_address_and_the_address_filters(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/lvis?tab=photos")
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
    assert chrome.js(COUNT) == f"{len(some)} of {len(everything)} photos"


def test_the_better_side_filters(chrome: Browser, page: Path) -> None:
    n = 0
    for side in ("0", "1", "tie"):
        chrome.open(page, f"#/lvis?tab=photos&wins={side}")
        n += len(chrome.js(SHOWN))
    assert n == 12


def test_a_cost_s_link_lists_its_photos(chrome: Browser, page: Path) -> None:
    """The first screen says how many images an error is in; its link shows just those."""
    (data,) = embedded_json(page, "data")
    cost = data["sections"][0]["first"]["costs"][0]["most"][0]
    chrome.open(page, "#/coco")
    click(chrome, f"{SECTION} .costs a")
    assert len(chrome.js(SHOWN)) == cost["images"] > 0
    assert chrome.js("location.hash").startswith(f"#/coco{cost['link']}")


def test_the_keyboard_walks_the_gallery(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco?tab=photos&sort=file")
    order = chrome.js(SHOWN)
    focused = "document.activeElement.dataset.image"
    chrome.js(f"{CARDS}[0].focus()")
    chrome.key("ArrowRight")
    assert chrome.js(focused) == order[1]
    chrome.key("End")
    assert chrome.js(focused) == order[-1]
    chrome.key("Home")
    chrome.key("Enter")
    chrome.until("!document.querySelector('#detail').hidden")
    assert chrome.js("document.querySelector('#detail h2').textContent") == "000.jpg"
    chrome.key("Escape")
    assert chrome.js(focused) == order[0], "the card that was opened has the focus again"


def test_arrow_keys_walk_the_list_and_keep_the_focus(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco?tab=photos&sort=file")
    order = chrome.js(SHOWN)
    chrome.open(page, f"#/coco/{order[3]}?tab=photos&sort=file")
    assert chrome.js("document.querySelector('#detail h2').textContent") == "003.jpg"
    chrome.js("document.querySelector('[data-keep=next]').focus()")
    chrome.key("Enter")
    assert chrome.js("location.hash") == f"#/coco/{order[4]}?tab=photos&sort=file"
    assert chrome.js("document.activeElement.dataset.keep") == "next"
    chrome.key("ArrowLeft")
    chrome.key("ArrowLeft")
    assert chrome.js("location.hash") == f"#/coco/{order[2]}?tab=photos&sort=file"
    chrome.key("Escape")
    assert chrome.js("document.querySelector('#pages').hidden") is False
    assert chrome.js("document.activeElement.dataset.image") == order[2]
    chrome.js("history.back()")
    chrome.until("!document.querySelector('#detail').hidden")
    assert chrome.js("location.hash") == f"#/coco/{order[2]}?tab=photos&sort=file"


def test_a_photo_that_is_not_there_is_said(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco/99999")
    assert "No photo 99999" in chrome.js("document.querySelector('#detail').textContent")


def test_boxes_are_drawn_where_they_are(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco/10")
    drawn = chrome.js(
        "Array.from(document.querySelectorAll('.frame .s-tp .line')).map(p => p.getAttribute('d'))"
    )
    view = json.loads(chrome.js("document.getElementById('view-0').textContent"))
    found = [p["box"] for p in view["sides"][0]["predictions"] if p["o"] == "tp"]
    assert found
    assert sorted(drawn) == sorted(f"M{x} {y}h{w}v{h}h{-w}Z" for x, y, w, h in found)
    assert chrome.js("document.querySelector('.frame').getAttribute('viewBox')") == "0 0 120 90"
    loaded = "document.querySelector('.frame image').href.baseVal.slice(0, 22)"
    assert chrome.js(loaded) == "data:image/webp;base64"


def test_layers_switch_and_are_in_the_address(chrome: Browser, page: Path) -> None:
    lines = "Array.from(document.querySelectorAll('.frame {} .line'))"
    visible = f"{lines}.filter(n => n.getClientRects().length).length"
    chrome.open(page, "#/lvis/13")
    assert chrome.js(visible.format(".s-fp")) > 0
    click(chrome, "[data-layer=fp]")
    assert chrome.js(visible.format(".s-fp")) == 0
    address = chrome.js("location.hash")
    assert "show=truth.tp.fn.names" in address
    chrome.open(page, address)
    assert chrome.js(visible.format(".s-fp")) == 0
    assert chrome.js(visible.format(".s-truth")) > 0
    click(chrome, "[data-layer=fp]")
    assert "show" not in chrome.js("location.hash")


def test_masks_are_outlined_along_their_pixels(chrome: Browser, tmp_path: Path) -> None:
    """Painted by the browser, an outline fills exactly the pixels of its mask."""
    random = np.random.default_rng(0)
    truth = random_truth("lvis", seed=3, images=1)
    shapes = [random.random((90, 120)) < share for share in (0.02, 0.5, 0.9)]
    shapes.append(cv2.circle(np.zeros((90, 120), np.uint8), (60, 45), 30, 1, 7) > 0)
    masks = [compress_mask(rle_of(m), (90, 120)) for m in shapes]
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
        tmp_path / "r.html", evaluate(tmp_path, "lvis", truth=truth, predictions=predictions)
    )
    chrome.open(page, f"#/lvis/{truth['images'][0]['id']}?show=tp.fp.other")
    painted = chrome.js(
        """Array.from(document.querySelectorAll(
             '.frame .shape:not(.s-truth):not(.s-fn) .line')).map(path => {
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
    panes = chrome.js(
        "Array.from(document.querySelectorAll('.pane figcaption'), f => f.textContent)"
    )
    assert panes == ["ground truth", "scene, aligned", "scene minus ground truth"]
    box = chrome.js(
        "JSON.parse(JSON.stringify(document.querySelector('.frame').getBoundingClientRect()))"
    )
    chrome.move_mouse(box["x"] + box["width"] * 20.5 / 80, box["y"] + box["height"] * 30.5 / 60)
    text = chrome.js("document.querySelector('.readout').textContent")
    z = plane((80, 60))[30, 20]
    assert text.startswith(f"near x 20, y 30: ground truth {z:.3f} m; scene {z:.3f} m, off")
    crosses = "Array.from(document.querySelectorAll('.cross'), c => c.getAttribute('visibility'))"
    assert chrome.js(crosses) == ["visible"] * 3
    ticks = chrome.js(
        "Array.from(document.querySelectorAll('.ticks span')).map(t => t.textContent)"
    )
    assert len(ticks) == 10
    assert all(t.endswith(" m") for t in ticks)


ADDRESSES = ["#/coco", "#/coco?tab=photos", "#/lvis?tab=plots", "#/lvis?tab=numbers",
             "#/coco?tab=repeat", "#/coco/10", "#/lvis/13", "#/eth3d", "#/eth3d?tab=plots",
             "#/eth3d/1"]  # fmt: skip


@pytest.mark.parametrize("hash_text", ADDRESSES)
def test_narrow_dark_and_light(chrome: Browser, page: Path, hash_text: str) -> None:
    for width, schemes in ((390, ("light", "dark")), (1400, ("dark", "light"))):
        chrome.resize(width)
        for scheme in schemes:
            chrome.prefer(scheme)
            if scheme == schemes[0]:  # the other one is switched to
                chrome.open(page, hash_text)
            assert chrome.js(OVERHANG) == 0
            ground = chrome.js("getComputedStyle(document.body).backgroundColor")
            light = int(ground.strip("rgb()").split(",")[0])
            assert (light > 200) == (scheme == "light")
    chrome.resize(1280)


def test_the_worst_photo_with_an_answer_is_the_first_thing_seen(
    chrome: Browser, page: Path
) -> None:
    chrome.open(page, "#/lvis")
    head = chrome.js(f"document.querySelector('{SECTION} .worst-head').textContent")
    assert head.startswith("Worst photo with an answer: ")
    panes = f"document.querySelectorAll('{SECTION} .worst .pane')"
    bottom = f"Math.max(...Array.from({panes}, p => p.getBoundingClientRect().bottom))"
    assert chrome.js(f"{panes}.length") >= 2
    assert chrome.js(bottom) < 900
    wide = f"document.querySelector('{SECTION} .forest').getBoundingClientRect().width"
    assert chrome.js(wide) <= 700


def test_an_unknown_section_is_said_and_the_first_is_shown(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/nothing/3?tab=photos")
    assert "no section nothing" in chrome.js("document.getElementById('strange').textContent")
    assert chrome.js(f"document.querySelector('{SECTION}').innerText.length") > 100
    chrome.page.locator("[data-tab-link=plots]").click()
    assert chrome.js("document.getElementById('strange').hidden")


def test_a_policy_that_refuses_the_scripts_is_said(chrome: Browser, page: Path) -> None:
    strict = {"Content-Security-Policy": "script-src 'none'", "Content-Type": "text/html"}
    chrome.page.route("http://strict.test/", lambda r: r.fulfill(path=page, headers=strict))
    chrome.page.goto("http://strict.test/")
    note = chrome.page.locator(".unscripted")
    note.wait_for()  # it is late, so that a page whose scripts run never shows it
    assert "Content-Security-Policy" in note.inner_text()
    chrome.page.unroute("http://strict.test/")
    chrome.said.clear()
    chrome.open(page)
    assert note.count() == 0


def test_what_was_not_looked_at_is_printed_too(chrome: Browser, page: Path) -> None:
    """Sections that were never open, and cards that no frame has drawn."""
    chrome.open(page, "#/coco?tab=numbers")
    chrome.js("window.dispatchEvent(new Event('beforeprint'))")
    empty = (
        "Array.from(document.querySelectorAll('[data-sheet] .thumb')).filter(t => !t.firstChild)"
    )
    assert chrome.js("document.querySelectorAll('[data-sheet] .thumb').length") > 12
    assert chrome.js(f"{empty}.length") == 0


def test_it_prints_every_section(chrome: Browser, page: Path) -> None:
    chrome.open(page, "#/coco")
    chrome.page.emulate_media(media="print")
    assert chrome.js("document.querySelector('[data-section=lvis]').offsetHeight") > 100
    assert chrome.js("getComputedStyle(document.querySelector('.tools')).display") == "none"
    assert len(chrome.pdf()) > 10_000
    chrome.page.emulate_media(media="screen")


def test_views_beside_the_page_are_loaded_from_the_disk(
    chrome: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_file, "EMBEDDED_VIEWS", 3)
    photos = write_photos(tmp_path / "photos", "coco")
    page = write(document_of(evaluate(tmp_path, "coco"), photos=photos), tmp_path / "r.html")
    chrome.open(page, "#/coco/13?sort=file")
    chrome.until("document.querySelector('.frame image')")
    chrome.key("ArrowRight")
    chrome.until("document.querySelector('#detail h2').textContent !== '001.jpg'")
    assert (
        chrome.js(
            "(async () => { const i = new Image(); "
            "i.src = document.querySelector('.frame image').href.baseVal; await i.decode(); "
            "return i.naturalWidth; })()"
        )
        == 120
    )


def test_a_comparison_without_its_evaluations_still_opens(chrome: Browser, tmp_path: Path) -> None:
    sides = [
        evaluate(tmp_path, "coco"),
        evaluate(tmp_path, "coco", kind="baseline", baseline="random"),
    ]
    folder = tmp_path / "comparison"
    assert cli.run(["compare", *map(str, sides), "-o", str(folder), "--draws", "20"]) == 0
    for side in sides:
        shutil.rmtree(side)
    chrome.open(page_of(tmp_path / "r.html", folder), "#/coco/10")
    chrome.key("ArrowRight")
    chrome.key("Escape")
    assert chrome.js("document.querySelectorAll('.numbers tbody tr').length") > 20
    assert chrome.js(OVERHANG) == 0


def test_views_that_were_left_behind_are_said(
    chrome: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_file, "EMBEDDED_VIEWS", 3)
    page = write(document_of(evaluate(tmp_path, "coco")), tmp_path / "r.html")
    (tmp_path / "r_files" / "view-000001.js").unlink()
    chrome.open(page, "#/coco/13")
    chrome.until(
        "document.querySelector('#detail').textContent.includes('keep the folder r_files')"
    )
    assert chrome.said  # once for each part of the page that asked for the file
    assert all("ERR_FILE_NOT_FOUND" in said for said in chrome.said)
    chrome.said.clear()


def test_only_the_cards_near_the_window_exist(chrome: Browser, tmp_path: Path) -> None:
    """Four hundred photos: every one is reached by scrolling, few are in the page at a time."""
    truth = random_truth("coco", seed=5, images=400)
    predictions = random_predictions("coco", truth, seed=5, per_image=2, levels=1)
    evaluation = evaluate(tmp_path, "coco", truth=truth, predictions=predictions)
    chrome.open(page_of(tmp_path / "r.html", evaluation), "#/coco?tab=photos")
    met, most = chrome.js(
        """(async () => {
          const met = new Set(); let most = 0;
          for (let y = 0; y < document.body.scrollHeight; y += 300) {
            window.scrollTo(0, y);
            await new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)));
            const cards = document.querySelectorAll('[data-gallery] a.card');
            cards.forEach(c => met.add(c.dataset.image));
            most = Math.max(most, cards.length);
          }
          return [met.size, most];
        })()"""
    )
    assert met == 400
    assert most < 100
    assert chrome.js(COUNT) == "400 of 400 photos"
    choose(chrome, "q", "39")
    shown = chrome.js(f"{CARDS}.map(a => a.querySelector('.card-file').textContent)")
    assert chrome.js(COUNT) == f"{len(shown)} of 400 photos"
    assert all("39" in name for name in shown)
