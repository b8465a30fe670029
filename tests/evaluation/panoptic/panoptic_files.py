"""Panoptic ground truth, and answers of others, written as panopticapi's converters write them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from legoworld import cli

#: Two things and two stuff categories of COCO's vocabulary.
CATEGORIES = [
    {"id": 1, "name": "person", "isthing": 1},
    {"id": 3, "name": "car", "isthing": 1},
    {"id": 187, "name": "sky-other-merged", "isthing": 0},
    {"id": 199, "name": "wall-other-merged", "isthing": 0},
]
#: A picture of ids, and (id, category id, iscrowd) of its segments.
Picture = tuple[np.ndarray, Sequence[tuple[int, int, int]]]


def write_ids(path: Path, ids: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    colors = np.stack([ids & 255, ids >> 8 & 255, ids >> 16], -1).astype(np.uint8)
    Image.fromarray(colors).save(path)


def write_panoptic(path: Path, pictures: Mapping[int, Picture], *, truth: bool = True) -> Path:
    """PATH and its folder of PNGs, of pictures by image id."""
    images, annotations = [], []
    for number, (ids, segments) in pictures.items():
        write_ids(path.with_suffix("") / f"{number}.png", ids)
        listed = [
            {"id": i, "category_id": c, "iscrowd": crowd, "area": int((ids == i).sum()),
             "bbox": [0, 0, 1, 1]}
            for i, c, crowd in segments
        ]  # fmt: skip
        annotations.append(
            {"image_id": number, "file_name": f"{number}.png", "segments_info": listed}
        )
        high, wide = ids.shape
        images.append({"id": number, "file_name": f"{number}.jpg", "width": wide, "height": high})
    document: dict[str, Any] = {"annotations": annotations}
    if truth:
        document |= {"images": images, "categories": CATEGORIES}
    path.write_text(json.dumps(document))
    return path


def call(*words: object, code: int = 0) -> None:
    assert cli.run([str(word) for word in words]) == code


def scored(folder: Path, truth: Path, answers: Path, *, code: int = 0) -> dict[str, Any]:
    """The summary of answers of others that are imported and evaluated."""
    track = folder / "track.json"
    call("track", "make", "--task", "coco-panoptic", "--truth", truth, "-o", track, "--overwrite")
    where = ("--task", "coco-panoptic", "--track", track, "-o", folder / "run", "--overwrite")
    call("baseline", "import", "-q", answers, *where, code=code)
    words = ("--truth", truth, "-o", folder / "eval", "--draws", 50, "--overwrite")
    call("evaluate", "-q", folder / "run", *words)
    summary: dict[str, Any] = json.loads((folder / "eval/summary.json").read_text())
    return summary
