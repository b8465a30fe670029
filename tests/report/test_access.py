"""The page for everybody: axe's rules, the keyboard alone, touch, both widths and both schemes."""

from __future__ import annotations

import html
import json
import re
import unicodedata
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from evaluation.depth.folders import evaluate_depth, plane, write_arrays, write_run
from report.bench_pages import bench_dataset, bench_evaluation, troubled_submissions
from report.chromium import Browser, browser
from report.pages import embedded_json, evaluate, page_of, write_photos

from legoworld import cli

AXE = Path(__file__).parents[2] / "tools" / "page" / "node_modules" / "axe-core" / "axe.min.js"
ADDRESSES = ["#/coco", "#/coco?tab=photos", "#/coco?tab=plots", "#/coco?tab=numbers",
             "#/coco?tab=repeat", "#/coco/13", "#/coco/10", "#/eth3d", "#/eth3d?tab=plots",
             "#/eth3d/1", "#/bench", "#/bench?tab=photos", "#/bench?tab=plots",
             "#/bench?tab=numbers", "#/bench/2", "#/bench/4"]  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A comparison of boxes with a failed image, depth, and a bench, with photos."""
    folder = tmp_path_factory.mktemp("page")
    sides = [
        evaluate(folder, "coco", statuses={10: "failed"}),
        evaluate(folder, "coco", levels=None, kind="baseline", baseline="random"),
    ]
    compared = folder / "comparison"
    assert cli.run(["compare", *map(str, sides), "-o", str(compared), "--draws", "20"]) == 0
    truth = {"a.png": plane((80, 60))}
    run = write_run(folder / "run", {"a.png": 1.5 * truth["a.png"]})  # type: ignore[dict-item]
    evaluate_depth(run, write_arrays(folder / "truth", truth), folder / "depth", draws=5)
    dataset = bench_dataset(folder)
    bench = bench_evaluation(folder, dataset, "mine", troubled_submissions(dataset))
    photos = write_photos(folder / "photos", "coco")
    return page_of(folder / "report.html", compared, folder / "depth", bench, photos=photos)


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    with browser(has_touch=True, bypass_csp=True) as opened:
        yield opened


@pytest.fixture(scope="module")
def axe() -> str:
    if not AXE.is_file():
        pytest.skip("axe-core is not installed: run npm ci in tools/page")
    return AXE.read_text(encoding="utf-8")


@pytest.mark.parametrize("width", [390, 1400])
def test_axe_finds_nothing(chrome: Browser, page: Path, axe: str, width: int) -> None:
    chrome.resize(width)
    found = {}
    for address in ADDRESSES:
        chrome.open(page, address)
        chrome.js("document.querySelectorAll('details').forEach(d => { d.open = true; })")
        chrome.page.evaluate(axe)
        for scheme in ("dark", "light"):
            chrome.prefer(scheme)
            result = chrome.js("axe.run(document, { resultTypes: ['violations'] })")
            found[f"{address} {scheme}"] = [
                (v["id"], [n["html"][:160] for n in v["nodes"][:3]]) for v in result["violations"]
            ]
    assert {a: v for a, v in found.items() if v} == {}, json.dumps(found, indent=1)[:3000]


def test_the_tab_key_reaches_every_control(chrome: Browser, page: Path) -> None:
    """What can be clicked can be reached, and shows that it is."""
    chrome.resize(1400)
    for address in ("#/coco", "#/coco?tab=photos", "#/coco/13", "#/bench/4"):
        chrome.open(page, address)
        chrome.js("document.activeElement.blur()")
        wanted = chrome.js(
            """Array.from(document.querySelectorAll(`a[href], button:not(:disabled), select, input,
               summary, [tabindex="0"]`)).filter(n => n.checkVisibility()).length"""
        )
        chrome.js("void addEventListener('focusin', event => { event.target.__seen = true; })")
        for _ in range(wanted + 12):
            chrome.key("Tab")
        left = chrome.js(
            """Array.from(document.querySelectorAll(`a[href], button:not(:disabled), select, input,
               summary, [tabindex="0"]`)).filter(n => n.checkVisibility() && !n.__seen)
               .map(n => n.outerHTML.slice(0, 120))"""
        )
        assert left == [], f"{address}: {len(left)} of {wanted} are not reached"


def test_a_tap_on_an_outline_keeps_it_and_lights_its_row(chrome: Browser, page: Path) -> None:
    chrome.resize(390)
    chrome.open(page, "#/coco/13")
    item = chrome.js(
        """(() => { const shapes = Array.from(document.querySelectorAll('.frame .shape.s-fp'));
           const s = shapes[shapes.length - 1];
           s.scrollIntoView({ block: 'center' }); const b = s.getBoundingClientRect();
           return { id: s.dataset.items, x: b.x + b.width / 2, y: b.y + b.height / 2 }; })()"""
    )
    chrome.page.touchscreen.tap(item["x"], item["y"])
    pinned = "Array.from(document.querySelectorAll('.shape.pinned'), n => n.dataset.items)"
    (top,) = set(chrome.js(pinned))
    row = f"document.querySelector('tr[data-items=\"{top}\"]').classList.contains('pinned')"
    assert chrome.js(row)
    assert chrome.js("document.querySelector('.picked').textContent").count("positive") >= 1
    chrome.key("Escape")
    assert chrome.js(pinned) == []
    assert "13" in chrome.js("location.hash"), "the first Esc lets go, the second leaves"


def test_the_keyboard_keeps_a_row_and_zooms_to_what_is_out_of_view(
    chrome: Browser, page: Path
) -> None:
    chrome.resize(1400)
    chrome.open(page, "#/coco/13")
    view = "document.querySelector('.frame').getAttribute('viewBox')"
    boxes = "Array.from(document.querySelectorAll('.frame'), f => f.getAttribute('viewBox'))"
    views = f"new Set({boxes}).size"
    whole = chrome.js(view)
    chrome.js("document.querySelector('.frame').focus()")
    for _ in range(6):
        chrome.key("+")
    assert chrome.js(view) != whole
    assert chrome.js(views) == 1, "all panes show the same part"
    chrome.js("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    for k in range(3):
        button = f"document.querySelectorAll('.objects button.pick')[{k}]"
        chrome.js(f"{button}.focus()")
        chrome.key("Enter")
        shown = chrome.js(
            f"""(() => {{ const id = {button}.dataset.items;
               const shape = document.querySelector(`.shape[data-items="${{id}}"]`);
               const b = shape.getBoundingClientRect();
               const f = document.querySelector('.frame').getBoundingClientRect();
               return b.right > f.left && b.left < f.right && b.bottom > f.top && b.top < f.bottom;
            }})()"""
        )
        assert shown, "what is kept is in view"
    chrome.js("document.querySelector('.frame').focus()")
    chrome.key("0")
    assert chrome.js(view) == whole


def test_plots_are_saved_as_csv_and_svg(chrome: Browser, page: Path, tmp_path: Path) -> None:
    chrome.resize(1400)
    chrome.open(page, "#/coco?tab=plots")
    titles = chrome.js("Array.from(document.querySelectorAll('.plot h3'), h => h.textContent)")
    assert titles[:4] == [
        "Precision and recall at IoU 0.5",
        "Error kinds",
        "How well predictions fit",
        "AP by category",
    ]
    n_rows = chrome.js(
        "Array.from(document.querySelectorAll('.plot'), p => p.querySelectorAll('tbody tr').length)"
    )
    for k in range(4):
        figure = chrome.page.locator(".plot").nth(k)
        for name in ("CSV", "SVG"):
            with chrome.page.expect_download() as waiting:
                figure.get_by_text(name, exact=True).click()
            path = tmp_path / waiting.value.suggested_filename
            waiting.value.save_as(path)
            text = path.read_text(encoding="utf-8")
            if name == "CSV":
                assert len(text.splitlines()) == n_rows[k] + 1
            else:
                assert text.startswith("<svg ")
                assert 'xmlns="http://www.w3.org/2000/svg"' in text
                assert "class=" not in text, "it needs no style sheet"
                keys = figure.locator(".legend-key").all_inner_texts()
                drawn = [html.unescape(t) for t in re.findall("<text [^>]*>([^<]*)</text>", text)]
                assert drawn[-len(keys) :] == [key.strip() for key in keys], "its legend, once"


def test_tie_orders_are_saved_with_every_order_counted(
    chrome: Browser, page: Path, tmp_path: Path
) -> None:
    chrome.open(page, "#/coco?tab=plots")
    with chrome.page.expect_download() as waiting:
        chrome.page.locator(".ties").first.get_by_text("CSV", exact=True).click()
    waiting.value.save_as(tmp_path / "ties.csv")
    head, *rows = (tmp_path / "ties.csv").read_text().splitlines()
    assert head == "AP from,to,orders"
    assert sum(int(row.split(",")[2]) for row in rows) == 20, "the evaluation's draws"


def test_the_curve_s_area_is_ap50(page: Path) -> None:
    (data,) = embedded_json(page, "data")
    section = data["sections"][0]
    for curve in section["plots"]["precision_recall"]:
        if curve["policy"] != "own scores":
            continue
        folder = page.parent / f"eval-coco-{curve['label']}"
        ap50 = json.loads((folder / "summary.json").read_text())["metrics"]["AP50"]
        assert sum(curve["precision"]) / 101 == pytest.approx(ap50, abs=1e-4)


def test_a_case_shows_every_picture_and_its_points_in_3d(chrome: Browser, page: Path) -> None:
    chrome.resize(1400)
    chrome.open(page, "#/bench/4")
    panes = "Array.from(document.querySelectorAll('.pane figcaption'), f => f.textContent)"
    assert chrome.js(panes) == [
        "reference",
        "render",
        "hit and miss",
        "error of A",
        "surfaces in 3D",
    ]
    chrome.until("document.querySelector('.scene3d[data-ready]')")
    coloured = """(() => { const c = document.querySelector('.scene3d canvas');
        const small = document.createElement('canvas'); small.width = 48; small.height = 27;
        const d = small.getContext('2d'); d.drawImage(c, 0, 0, 48, 27);
        const p = d.getImageData(0, 0, 48, 27).data; const seen = { blue: 0, yellow: 0 };
        for (let i = 0; i < p.length; i += 4) {
          if (p[i + 2] > p[i] + 60) { seen.blue += 1; }
          if (p[i] > 100 && p[i + 1] > 100 && p[i + 2] < 90) { seen.yellow += 1; } }
        return seen; })()"""
    seen = chrome.js(coloured)
    assert seen["blue"] > 20, "hit"
    assert seen["yellow"] > 20, "missed"
    chrome.js("document.querySelector('.scene3d .switches button').click()")
    assert chrome.js(coloured)["yellow"] == 0, "missed points are the reference's"


def test_a_case_s_row_lights_its_outline_and_a_check_is_spelt_out(
    chrome: Browser, page: Path
) -> None:
    chrome.open(page, "#/bench/4")
    chrome.js("document.querySelector('.objects button.pick').focus()")
    item = chrome.js("document.activeElement.dataset.items")
    lit = f"document.querySelectorAll('.shape.s-object.hot[data-items=\"{item}\"]').length"
    assert chrome.js(lit) == 4, "in every picture"
    chrome.open(page, "#/bench/2")
    text = chrome.js("document.querySelector('.lists').textContent")
    assert "validity, 1 of 5 checks failed" in text
    assert "export it again" in text


def test_cases_are_listed_by_tier_and_flag(chrome: Browser, page: Path) -> None:
    cards = "document.querySelectorAll('[data-section=bench] [data-gallery] a.card')"
    shown = f"Array.from({cards}, a => a.dataset.image)"
    chrome.open(page, "#/bench?tab=photos&sort=file")
    everything = chrome.js(shown)
    chrome.open(page, "#/bench?tab=photos&sort=file&tier=hard")
    hard = chrome.js(shown)
    assert len(everything) == 8
    assert hard == ["2", "4", "6", "8"]
    chrome.open(page, "#/bench?tab=photos&flag=drivers")
    assert chrome.js(shown) == ["6"]
    chrome.open(page, "#/bench?tab=photos&status=failed")
    assert chrome.js(shown) == ["1"]


FIRST_SCREEN = {"#/coco": [".verdict", ".worst-head a", ".pane:nth-child(2)"],
                "#/coco/13": [".frame", ".score-line"],
                "#/bench": [".verdict", ".worst-head a", ".pane:nth-child(3)"],
                "#/bench/4": [".frame", ".score-line"]}  # fmt: skip
#: Where there is room beside the picture.
WIDE_TOO = {"#/coco": [".costs li", ".coverage-bar", ".forest .point"], "#/coco/13": [".advice li"],
            "#/bench": [".numbers tbody b"],
            "#/bench/4": [".advice li"]}  # fmt: skip


@pytest.mark.parametrize("size", [(1400, 900), (390, 844)])
def test_the_first_screen_answers_without_scrolling(
    chrome: Browser, page: Path, size: tuple[int, int]
) -> None:
    """What a newcomer asks first, the verdict, the reason and a picture, begins on it."""
    chrome.resize(*size)
    for address, wanted in FIRST_SCREEN.items():
        chrome.open(page, address)
        for selector in [*wanted, *(WIDE_TOO[address] if size[0] > 1000 else [])]:
            box = chrome.js(
                f"""(() => {{ const all = Array.from(document.querySelectorAll('{selector}'));
                   const n = all.find(m => m.checkVisibility());
                   const b = n.getBoundingClientRect(); return [b.left, b.top, b.right]; }})()"""
            )
            left, top, right = box
            assert 0 <= left < right <= size[0], (address, selector, box)
            assert 0 <= top < size[1] - 20, (address, selector, box)


FIGURES = [
    ("#/coco", ".forest"), ("#/coco?tab=plots", ".plot"), ("#/coco?tab=plots", ".ties"),
    ("#/eth3d?tab=plots", ".plot"), ("#/bench", ".tiers"), ("#/bench?tab=plots", ".plot"),
]  # fmt: skip


@pytest.mark.parametrize(("address", "selector"), FIGURES)
def test_a_figure_is_printed_alone_with_its_fonts(
    chrome: Browser, page: Path, address: str, selector: str
) -> None:
    """One page of the figure's size; its text is found through the fonts' own maps to Unicode."""
    chrome.prefer("dark")
    chrome.resize(1400)
    chrome.open(page, address)
    chrome.page.evaluate("window.print = () => undefined")
    title = chrome.page.title()
    figure = chrome.page.locator(selector).first
    drawn = figure if selector in (".forest", ".tiers") else figure.locator("svg[viewBox][role]")
    width, height = drawn.evaluate("n => [n.viewBox.baseVal.width, n.viewBox.baseVal.height]")
    held = chrome.page.locator("figure").filter(has=chrome.page.locator(selector))
    owner = held.first if selector in (".forest", ".tiers") else figure
    keys = [key.strip() for key in owner.locator(".legend-key").all_inner_texts()]
    owner.get_by_role("button", name=" as PDF").focus()
    chrome.key("Enter")
    assert chrome.page.title() != title, "the file's name"
    pdf = chrome.pdf()
    chrome.until("!document.getElementById('figure-alone')")
    assert chrome.page.title() == title
    (box,) = re.findall(rb"/MediaBox ?\[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    page_width, page_height = (float(v) / 0.75 for v in box)
    assert page_width == pytest.approx(width, abs=1.5)
    assert bool(keys) == (page_height > height + 10)
    assert page_height < height + 6 + 18 * len(keys)
    assert re.findall(rb"/Type0\b", pdf), "fonts with all their signs"
    embedded_fonts = len(re.findall(rb"/FontFile[23]\b", pdf))
    assert embedded_fonts == len(re.findall(rb"/Type ?/FontDescriptor\b", pdf)) > 0
    assert not re.search(rb"/Subtype ?/Type3", pdf)
    said = printed_text(pdf)
    words = "n => Array.from(n.childNodes, c => c.nodeType === 3 ? c.data : '').join('')"
    wanted = "".join([*drawn.locator("text").evaluate_all(f"all => all.map({words})"), *keys])
    texts = [re.sub(r"\s", "", unicodedata.normalize("NFKC", t)) for t in (said, wanted)]
    assert texts[0] == texts[1], "all of its text, and none of the rest of the page"


def printed_text(pdf: bytes) -> str:
    """What Chromium's PDF shows, each glyph by its font's map to Unicode."""
    objects = dict(re.findall(rb"(?:^|\n)(\d+) 0 obj\n(.*?)\nendobj", pdf, re.DOTALL))

    def stream(at: bytes) -> bytes:
        data = objects[at].split(b"stream\n", 1)[1].rsplit(b"\nendstream", 1)[0]
        return zlib.decompress(data) if b"/FlateDecode" in objects[at] else data

    maps: dict[bytes, dict[int, str]] = {}
    for font, body in objects.items():
        for at in re.findall(rb"/ToUnicode (\d+) 0 R", body):
            maps[font] = signs = {}
            for kind, lines in re.findall(
                rb"beginbf(char|range)\n(.*?)endbf", stream(at), re.DOTALL
            ):
                for line in lines.splitlines():
                    low, *rest = (int(v, 16) for v in re.findall(rb"<(\w+)>", line))
                    high, first = (low, rest[0]) if kind == b"char" else rest
                    signs |= {k: chr(first + k - low) for k in range(low, high + 1)}
    (content,) = (
        at for page in objects.values() for at in re.findall(rb"/Contents (\d+) 0 R", page)
    )
    shown, font = [], b""
    for name, glyphs in re.findall(rb"/F(\d+) [\d.]+ Tf|<([0-9A-Fa-f]+)>", stream(content)):
        font = name or font
        codes = [int(glyphs[k : k + 4], 16) for k in range(0, len(glyphs), 4)]
        shown += [maps[font][code] for code in codes]
    return "".join(shown)
