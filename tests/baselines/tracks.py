"""Photos, tracks and run folders for tests of baselines."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from legoworld import cli

FAKE = Path(__file__).parent / "fake"
FAKE_BATCHED = Path(__file__).parent / "fake_batched"
CATEGORIES = [{"id": 18, "name": "dog"}, {"id": 17, "name": "cat"}]
NAMES_OF_TWO = ["001.jpg", "002.jpg"]
SIZE_WH = (64, 48)


def make_photos(folder: Path, names: Sequence[str]) -> Path:
    """Random photos, each another one."""
    for number, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        random = np.random.default_rng(number)
        pixels = random.integers(0, 256, (SIZE_WH[1], SIZE_WH[0], 3)).astype(np.uint8)
        Image.fromarray(pixels).save(path, quality=95)
    return folder


def make_track(path: Path, names: Sequence[str], *, categories: Any = None) -> Path:
    """A track of these photos with ids from 1."""
    images = [
        {"id": n, "file_name": name, "width": SIZE_WH[0], "height": SIZE_WH[1]}
        for n, name in enumerate(names, start=1)
    ]
    document = {"info": {}, "images": images, "categories": categories or CATEGORIES}
    path.write_text(json.dumps(document))
    return path


def run_arguments(
    track: Path,
    photos: Path,
    weights: Path,
    output: Path,
    *options: str,
    baseline: Path = FAKE,
    task: str = "coco",
) -> list[str]:
    """Arguments of `legoworld baseline run` with this Python."""
    return [
        "baseline", "run", str(baseline), "--task", task, "--track", str(track),
        "--photos", str(photos), "--weights", str(weights), "-o", str(output),
        "--python", sys.executable, *options,
    ]  # fmt: skip


def call(arguments: Sequence[object]) -> int:
    return cli.run([*map(str, arguments)])


def results(run: Path) -> dict[str, bytes]:
    """Everything a run wrote that must be the same bytes every time."""
    return {
        str(p.relative_to(run)): p.read_bytes()
        for p in sorted(run.rglob("*"))
        if p.is_file() and p.name != "run.json"
    }


def rows(run: Path) -> dict[int, dict[str, Any]]:
    lines = (run / "per_image.jsonl").read_text().splitlines()
    return {row["image_id"]: row for row in map(json.loads, lines)}


def run_document(run: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((run / "run.json").read_text())
    return document
