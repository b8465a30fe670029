"""The pictures of the report page: python docs/report_pictures.py --demo PAGE.

`make pictures` makes the demo first. --comparison: the page of docs/real-run.md; only its numbers
are pictured, since its photos may not be passed on. --bench: that of `make bench-demo`. --tutorial:
where first.html and report.html of docs/tutorial.md lie. --every-question: the scenes of
examples/every-question, whose photos may not be passed on either: their own answers are pictured.
Needs playwright and Chromium.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Browser, sync_playwright

import legoworld
from legoworld.readouts.pictures import instance_picture, read_photo

PICTURES: Final = Path(__file__).parent / "pictures"
#: WebGL by software, so that a machine without a GPU draws the same.
_ARGUMENTS: Final = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_QUALITY: Final = 70
_SCENE: Final = ".scene3d[data-ready]"
_CELL_ROWS: Final = 150


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A picture: what is opened, how large, and what is waited for."""

    name: str
    address: str
    size: tuple[int, int]
    wait: str = ".thumb svg"
    scheme: str = "light"


#: Of the coffee photo alone: it is CC0.
_DEMO: Final = (
    Shot(name="readme-report", address="#/lvis/3?panes=side0.slide0.differ0.scene0",
         size=(1400, 890), wait=_SCENE),
    Shot(name="report-photo", address="#/coco/3?panes=side0.scene0", size=(1400, 560),
         wait=_SCENE, scheme="dark"),
    Shot(name="report-phone", address="#/lvis/3?panes=side0.scene0", size=(390, 844), wait=_SCENE),
)  # fmt: skip
_COMPARISON: Final = (
    Shot(name="report-comparison", address="#/coco", size=(1400, 668)),
    Shot(name="report-plots", address="#/coco?tab=plots", size=(1400, 1010), wait=".plot svg"),
)
#: Of KayKit's assets, which are CC0.
_BENCH: Final = (
    Shot(name="report-bench", address="#/bench", size=(1400, 900)),
    Shot(name="report-bench-case", address="#/bench/9", size=(1400, 720), wait=_SCENE),
)
_TUTORIAL: Final = {
    "first.html": Shot(name="tutorial-report", address="#/coco/3", size=(1200, 640),
                       wait=".frame"),
    "report.html": Shot(name="tutorial-masks", address="#/lvis/3?panes=side0", size=(1200, 700),
                        wait=".frame"),
}  # fmt: skip


def main() -> int:
    """Take the pictures of every page that is given."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--demo", type=Path)
    parser.add_argument("--comparison", type=Path)
    parser.add_argument("--bench", type=Path)
    parser.add_argument("--tutorial", type=Path)
    parser.add_argument("--every-question", type=Path)
    options = parser.parse_args()
    shots: list[tuple[Path, Shot]] = []
    shots += [(options.demo, shot) for shot in _DEMO if options.demo]
    shots += [(options.comparison, shot) for shot in _COMPARISON if options.comparison]
    shots += [(options.bench, shot) for shot in _BENCH if options.bench]
    if options.tutorial:
        shots += [(options.tutorial / page, shot) for page, shot in _TUTORIAL.items()]
    if options.every_question:
        _sheet(sorted(path for path in options.every_question.iterdir() if path.is_dir()))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=_ARGUMENTS
        )
        for page, shot in shots:
            _take(browser, page, shot)
        browser.close()
    return 0


def _take(browser: Browser, path: Path, shot: Shot) -> None:
    width, height = shot.size
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme=shot.scheme,  # type: ignore[arg-type]
        device_scale_factor=1.25 if width > 1000 else 1.5,
    )
    page = context.new_page()
    page.goto(path.resolve().as_uri() + shot.address)
    page.wait_for_selector(shot.wait)
    page.wait_for_timeout(500)  # pictures inside SVG are decoded after they are there
    _write(page.screenshot(), PICTURES / f"{shot.name}.webp")
    context.close()


def _sheet(scenes: list[Path]) -> None:
    """A column for each scene: its render, instances, depth and normals."""
    columns = []
    for folder in scenes:
        view = legoworld.open_scene(folder).view()
        normals = np.rint(np.nan_to_num(0.5 - 0.5 * view.normals()) * 255.0).astype(np.uint8)
        cells = (read_photo(folder / "final.png"), instance_picture(view.instance),
                 view.depth_picture(), normals)  # fmt: skip
        columns.append(np.concatenate([_cell(picture) for picture in cells]))
    sheet = np.ascontiguousarray(np.concatenate(columns, axis=1)[:, :, ::-1])
    _encode(sheet, PICTURES / "every-question.webp")


def _cell(picture: NDArray[np.uint8]) -> Any:
    height, width = picture.shape[:2]
    size_wh = (round(width * _CELL_ROWS / height), _CELL_ROWS)
    return cv2.resize(picture, size_wh, interpolation=cv2.INTER_AREA)


def _write(png: bytes, path: Path) -> None:
    _encode(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), path)


def _encode(picture: Any, path: Path) -> None:
    done, data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])
    assert done
    path.write_bytes(data.tobytes())
    print(f"{path.name}: {len(data) / 1e3:.0f} kB")


if __name__ == "__main__":
    raise SystemExit(main())
