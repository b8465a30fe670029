"""Size of a report page, and how long it takes a browser to load, filter and scroll it.

    python benchmarks/report/page.py --truth instances.json --results results.json \\
        --photos val2017 --images 12,500,5000

The truth's images are repeated until there are as many as asked for, each with its own photo,
annotations and predictions; the results are imported and evaluated, and a page is made of the
evaluation. Then an installed Chromium opens it from the disk: load is from navigation until the
first screen is drawn, filter from an input event until the new cards are laid out, both the
median of --rounds; scroll is the longest frame while the whole gallery passes by. Wall times are
this machine's, and the load average is printed with them; CPU times are those of the page's main
thread, which other processes do not move. Needs playwright.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, CDPSession, Page, sync_playwright

from legoworld import cli

FILTERED = """(text) => {
  const input = document.querySelector('section.task:not([hidden]) [data-filter=q]');
  const start = performance.now();
  input.value = text;
  input.dispatchEvent(new Event('input'));
  document.body.offsetHeight;
  return performance.now() - start;
}"""
DRAWN = "document.querySelector('[data-sheet] .thumb svg') !== null"
SCROLLED = """async () => {
  const frame = () => new Promise(requestAnimationFrame);
  const times = [];
  let before = await frame();
  for (let y = 0; y < document.body.scrollHeight; y += 400) {
    window.scrollTo(0, y);
    const now = await frame();
    times.push(now - before);
    before = now;
  }
  times.sort((a, b) => a - b);
  const nodes = document.querySelectorAll('[data-gallery] [data-at]').length;
  return [times[Math.floor(times.length / 2)], times[times.length - 1], nodes, times.length];
}"""


def main() -> int:
    """A line of the table for each number of images."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--page", type=Path, help="Time this page of boxes and make none.")
    parser.add_argument("--images", default="12,500,5000")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--chromium", default=shutil.which("chromium"))
    options = parser.parse_args()
    if not options.page and not (options.truth and options.results and options.photos):
        parser.error("--truth, --results and --photos, or --page")
    print("| images | making, s | page, MB | beside, MB | load, s | load, CPU s | filter, ms | "
          "filter, CPU ms | scrolling: median and longest frame, ms | a frame, CPU ms | "
          "cards in the page |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as work:
        browser = playwright.chromium.launch(executable_path=options.chromium)
        if options.page:
            print(timed(browser, options.page.resolve(), options.rounds), os.getloadavg()[0])
            browser.close()
            return 0
        for n in map(int, options.images.split(",")):
            folder = Path(work) / str(n)
            start = time.perf_counter()
            path = made_page(options, n, folder)
            spent = time.perf_counter() - start
            beside = path.with_name("report_files")
            bytes_beside = sum(p.stat().st_size for p in beside.glob("*"))
            found = timed(browser, path, options.rounds)
            print(f"| {n} | {spent:.1f} | {path.stat().st_size / 1e6:.1f} | "
                  f"{bytes_beside / 1e6:.1f} | {found.load_s:.2f} | {found.load_cpu_s:.2f} | "
                  f"{found.filter_ms:.1f} | {found.filter_cpu_ms:.1f} | "
                  f"{found.frame_ms[0]:.0f}, {found.frame_ms[1]:.0f} | {found.frame_cpu_ms:.1f} | "
                  f"{found.cards} |", flush=True)  # fmt: skip
            shutil.rmtree(folder)
        print(f"\nChromium {browser.version}, load average {os.getloadavg()[0]:.1f}")
        browser.close()
    return 0


@dataclass(frozen=True, kw_only=True)
class Timed:
    """What a browser needed. *_s, *_ms: of the wall; *_cpu: of the page's main thread.

    frame_ms: median and longest while the gallery scrolls; cards: that are in the page at its end.
    """

    load_s: float
    load_cpu_s: float
    filter_ms: float
    filter_cpu_ms: float
    frame_ms: tuple[float, float]
    frame_cpu_ms: float
    cards: int


def timed(browser: Browser, path: Path, rounds: int) -> Timed:
    """Load, filter and scroll a page; medians of the rounds."""
    loads = [_loaded(browser, path) for _ in range(rounds)]
    page, thread = _opened(browser)
    page.goto(path.as_uri() + "#/coco?tab=photos")
    page.wait_for_selector("[data-gallery] .thumb svg")
    filters = []
    for k in range(rounds):
        for text in (f"0{k}", ""):
            before = _cpu_s(thread)
            wall_ms = page.evaluate(FILTERED, text)
            filters.append((wall_ms, 1000 * (_cpu_s(thread) - before)))
    before = _cpu_s(thread)
    middle, longest, cards, frames = page.evaluate(SCROLLED)
    scrolled_s = _cpu_s(thread) - before
    page.close()
    return Timed(
        load_s=statistics.median(wall for wall, _ in loads),
        load_cpu_s=statistics.median(cpu for _, cpu in loads),
        filter_ms=statistics.median(wall for wall, _ in filters),
        filter_cpu_ms=statistics.median(cpu for _, cpu in filters),
        frame_ms=(middle, longest),
        frame_cpu_ms=1000 * scrolled_s / frames,
        cards=cards,
    )


def _loaded(browser: Browser, path: Path) -> tuple[float, float]:
    """Wall and main thread's seconds from navigation until the first screen is drawn."""
    page, thread = _opened(browser)
    start = time.perf_counter()
    page.goto(path.as_uri())
    page.wait_for_function(DRAWN)
    spent = time.perf_counter() - start, _cpu_s(thread)
    page.close()
    return spent


def _opened(browser: Browser) -> tuple[Page, CDPSession]:
    """A new page, and its main thread's clock, which other processes' load does not move."""
    page = browser.new_page(viewport={"width": 1400, "height": 900})
    thread = page.context.new_cdp_session(page)
    thread.send("Performance.enable", {"timeDomain": "threadTicks"})
    return page, thread


def _cpu_s(thread: CDPSession) -> float:
    metrics = thread.send("Performance.getMetrics")["metrics"]
    return next(float(m["value"]) for m in metrics if m["name"] == "TaskDuration")


def made_page(options: argparse.Namespace, n: int, folder: Path) -> Path:
    """The page of n images, and on the way its run and its evaluation."""
    photos = folder / "photos"
    photos.mkdir(parents=True)
    truth, results = repeated(options, n, photos)
    (folder / "truth.json").write_text(json.dumps(truth))
    (folder / "results.json").write_text(json.dumps(results))
    track, run, scored = folder / "track.json", folder / "run", folder / "eval"
    truth_options = ["--truth", str(folder / "truth.json")]
    run_of(["track", "make", "--task", "coco", *truth_options, "-o", str(track)])
    run_of(["baseline", "import", str(folder / "results.json"), "--task", "coco", "--track",
            str(track), "--name", "detector", "-o", str(run), "-q"])  # fmt: skip
    run_of(["evaluate", str(run), *truth_options, "--draws", "100", "-o", str(scored), "-q"])
    output = folder / "report.html"
    run_of(["report", str(scored), "--photos", str(photos), "-o", str(output), "-q"])
    return output


def run_of(words: list[str]) -> None:
    """One command, in silence."""
    with Path(os.devnull).open("w") as nowhere:
        kept, out = os.dup(1), nowhere.fileno()
        os.dup2(out, 1)
        try:
            if code := cli.run(words):
                raise SystemExit(f"{' '.join(words)}: exit {code}")
        finally:
            os.dup2(kept, 1)
            os.close(kept)


def repeated(options: argparse.Namespace, n: int, photos: Path) -> tuple[dict[str, Any], list[Any]]:
    """Truth and results of n images; every copy of a photo is a link to it."""
    truth = json.loads(options.truth.read_text())
    results = json.loads(options.results.read_text())
    images, annotations, entries = [], [], []
    for k in range(n):
        source = truth["images"][k % len(truth["images"])]
        name = f"{k:06}.jpg"
        size = {key: source[key] for key in ("width", "height")}
        images.append({**size, "id": k + 1, "file_name": name})
        (photos / name).symlink_to((options.photos / source["file_name"]).resolve())
        for one in truth["annotations"]:
            if one["image_id"] == source["id"]:
                annotations.append({**one, "id": len(annotations) + 1, "image_id": k + 1})
        entries += [{**r, "image_id": k + 1} for r in results if r["image_id"] == source["id"]]
    return {**truth, "images": images, "annotations": annotations}, entries


if __name__ == "__main__":
    raise SystemExit(main())
