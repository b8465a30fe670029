"""Evaluations and pages made for tests, with every kind of trouble in them."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from evaluation.detection_runs import (
    evaluate_detections,
    random_predictions,
    random_truth,
    write_run,
    write_truth,
)

from legoworld import cli
from legoworld.report.document import page_document
from legoworld.report.page_content import PageDocument
from legoworld.report.page_file import write_page
from legoworld.report.sources import read_sources

#: A name that would run, were it not escaped, wherever it stands.
HOSTILE = "</script><img src=x onerror=alert(1)>'\"&{{7*7}}\u2028"


def evaluate(
    folder: Path,
    task: str,
    *,
    seed: int = 1,
    images: int = 12,
    levels: int | None = 1,
    statuses: dict[int, str] | None = None,
    hostile: bool = False,
    truth: dict[str, Any] | None = None,
    predictions: Sequence[Any] | None = None,
    **configuration: Any,
) -> Path:
    """An evaluation of random predictions on random truth, below a folder."""
    truth = truth or random_truth(task, seed=seed, images=images)
    if hostile:
        truth["categories"][0]["name"] = HOSTILE
    if predictions is None:
        predictions = random_predictions(task, truth, seed=seed, levels=levels)
    read = [p for p in predictions if (statuses or {}).get(p["image_id"], "ok") == "ok"]
    name = str(configuration.get("baseline", "scene"))
    run = write_run(
        folder / f"run-{task}-{name}", task, truth, read, statuses=statuses, **configuration
    )
    if hostile:
        _scene_words(run)
    evaluation = folder / f"eval-{task}-{name}"
    evaluate_detections(
        run,
        write_truth(folder / f"truth-{task}.json", truth),
        evaluation,
        evaluator="official",
        draws=20,
        overwrite=True,
    )
    return evaluation


def _scene_words(run: Path) -> None:
    """Rows as a readout writes them, in the words of a hostile scene."""
    text = (run / "per_image.jsonl").read_text()
    rows = [json.loads(line) for line in text.splitlines()]
    for row in rows:
        row |= {
            "code": "ok",
            "reason": f"it is {HOSTILE}",
            "warnings": [f"warned of {HOSTILE}"],
            "rendered_wh": [120, 90],
            "scene_size_wh": [640, 480],
            "aspect_differs": False,
            "geometry_px": 5400,
            "instances": {
                "total": 5,
                "labelled": 3,
                "visible_labelled": 2,
                "visible_unlabelled": 2,
            },
            "unlabelled": [{"name": HOSTILE, "area_px": 1080}],
            "unmatched": [{"label": HOSTILE, "count": 2, "nearest": ["thing 1", HOSTILE]}],
            "unexported": [{"name": HOSTILE, "category": "thing 2", "reason": "outside_view"}],
            "matched": {HOSTILE: "thing 3"},
            "nested": {"instances": 1, "px": 40},
        }
    lines = (json.dumps(row, ensure_ascii=False) + "\n" for row in rows)
    (run / "per_image.jsonl").write_text("".join(lines))


def write_photos(folder: Path, task: str, *, seed: int = 1, images: int = 12) -> Path:
    """A noise picture of every image of `evaluated`, in val2017/."""
    random = np.random.default_rng(seed)
    for image in random_truth(task, seed=seed, images=images)["images"]:
        path = folder / "val2017" / image["file_name"]
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), random.integers(0, 255, (90, 120, 3), np.uint8))
    return folder


def document_of(*evaluations: Path, photos: Path | None = None) -> PageDocument:
    """What a page of these evaluations holds."""
    return page_document(read_sources(evaluations), photos)


def page_of(output: Path, *evaluations: Path, photos: Path | None = None) -> Path:
    """A written page, made by the command."""
    arguments = ["report", *map(str, evaluations), "-o", str(output), "-q"]
    assert cli.run([*arguments, *(["--photos", str(photos)] if photos else [])]) == 0
    return output


def write(document: PageDocument, output: Path) -> Path:
    """A written page of a document."""
    return write_page(document, output, commands=[]).path


class Tables(HTMLParser):
    """The cells of every table of a page, as text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self._open = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: Any) -> None:  # noqa: ARG002
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th") and self.rows:
            self.rows[-1].append("")
            self._open = True

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th"):
            self._open = False

    def handle_data(self, data: str) -> None:
        if self._open:
            self.rows[-1][-1] += data.strip()

    def row(self, name: str) -> list[str]:
        """The cells after a row's name; the first row of that name."""
        return next(row[1:] for row in self.rows if row and row[0] == name)


def embedded_json(path: Path, kind: str) -> list[Any]:
    """The JSON of the page's script elements whose id begins with a word."""
    text = path.read_text(encoding="utf-8")
    found = re.findall(rf'<script type="application/json" id="{kind}[^"]*">(.*?)</script>', text)
    return [json.loads(item) for item in found]


def plain(text: str) -> str:
    """Text as HTML holds it."""
    return html.escape(text, quote=True)
