"""Truths and results of any size, COCO-like boxes or LVIS-like masks, from a seed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pycocotools import mask as coco_mask

from legoworld.evaluation.run import Run
from legoworld.records.run_file import Configuration, RunHead
from legoworld.records.run_rows import RunImage
from legoworld.tracks.vocabulary import from_json

WIDTH, HEIGHT = 640, 480

Document = dict[str, Any]
Results = list[dict[str, Any]]


def coco_like(
    n_images: int, n_predictions: int, *, seed: int = 0, n_categories: int = 80
) -> tuple[Document, Results]:
    """Seven truths an image, 1 % of them crowds; a fifth of the predictions near a truth."""
    random = np.random.default_rng(seed)
    truth = _truth(random, n_images, 7 * n_images, n_categories)
    for k, annotation in enumerate(truth["annotations"]):
        annotation["iscrowd"] = int(k % 100 == 99)
    results = _results(random, truth, n_predictions, n_categories)
    return truth, results


def run_of(document: Document, task: str) -> Run:
    """A run of all of a truth's images."""
    configuration = Configuration(
        task=task,
        attempted=len(document["images"]),
        vocabulary_sha256=from_json(document["categories"], "").sha256,
    )
    images = (
        RunImage(image_id=i["id"], file_name=i["file_name"], status="ok")
        for i in document["images"]
    )
    return Run(folder=Path("run"), head=RunHead(configuration=configuration), images=tuple(images))


def lvis_like(
    n_images: int, n_predictions: int, *, seed: int = 0, n_categories: int = 1203
) -> tuple[Document, Results]:
    """Twelve truths an image as masks of boxes, ten verified absent categories an image."""
    random = np.random.default_rng(seed)
    truth = _truth(random, n_images, 12 * n_images, n_categories)
    for image in truth["images"]:
        image["neg_category_ids"] = (random.choice(n_categories, 10, replace=False) + 1).tolist()
        image["not_exhaustive_category_ids"] = (
            random.choice(n_categories, 1, replace=False) + 1
        ).tolist()
    results = _results(random, truth, n_predictions, n_categories)
    for entry in truth["annotations"]:
        entry["segmentation"] = _mask(entry["bbox"])
        entry["area"] = float(entry["bbox"][2] * entry["bbox"][3])
    for entry in results:
        entry["segmentation"] = _mask(entry.pop("bbox"))
    return truth, results


def _truth(random: np.random.Generator, n_images: int, n: int, n_categories: int) -> Document:
    image = random.integers(1, n_images + 1, n)
    weights = 1.0 / np.arange(1, n_categories + 1)
    category = random.choice(n_categories, n, p=weights / weights.sum()) + 1
    boxes = _boxes(random, n)
    return {
        "images": [
            {"id": i + 1, "file_name": f"{i + 1:012}.jpg", "width": WIDTH, "height": HEIGHT}
            for i in range(n_images)
        ],
        "annotations": [
            {
                "id": k + 1,
                "image_id": int(image[k]),
                "category_id": int(category[k]),
                "bbox": boxes[k].tolist(),
                "area": float(boxes[k, 2] * boxes[k, 3]),
            }
            for k in range(n)
        ],
        "categories": [
            {"id": c + 1, "name": f"thing {c}", "frequency": "fcr"[min(2, c * 4 // n_categories)]}
            for c in range(n_categories)
        ],
    }


def _results(random: np.random.Generator, truth: Document, n: int, n_categories: int) -> Results:
    annotations = truth["annotations"]
    source = random.integers(0, len(annotations), n)
    near = random.random(n) < 0.2
    boxes = _boxes(random, n)
    true = np.array([a["bbox"] for a in annotations])[source]
    moved = true + np.round(random.normal(0, 0.06, (n, 4)) * true[:, [2, 3, 2, 3]])
    boxes[near] = _inside(moved[near])
    category = np.array([a["category_id"] for a in annotations])[source]
    other = random.random(n) > 0.8
    category[other] = random.integers(1, n_categories + 1, int(other.sum()))
    score = np.round(np.clip(random.beta(1, 4, n) + 0.3 * near, 0.001, 0.999), 4)
    return [
        {
            "image_id": annotations[source[k]]["image_id"],
            "category_id": int(category[k]),
            "bbox": boxes[k].tolist(),
            "score": float(score[k]),
        }
        for k in range(n)
    ]


def _boxes(random: np.random.Generator, n: int) -> np.ndarray:
    size = np.exp(random.uniform(np.log(8), np.log(300), (n, 2)))
    corner = random.random((n, 2)) * (np.array([WIDTH, HEIGHT]) - size)
    return _inside(np.concatenate([corner, size], axis=1).round())


def _inside(boxes: np.ndarray) -> np.ndarray:
    low = np.clip(boxes[:, :2], 0, [WIDTH - 2, HEIGHT - 2])
    high = np.clip(boxes[:, :2] + np.maximum(boxes[:, 2:], 2), low + 2, [WIDTH, HEIGHT])
    return np.concatenate([low, high - low], axis=1)


def _mask(box: list[float]) -> dict[str, Any]:
    x, y, w, h = box
    outline = [[x, y, x, y + h, x + w, y + h, x + w, y]]
    mask = coco_mask.merge(coco_mask.frPyObjects(outline, HEIGHT, WIDTH))
    return {"size": [HEIGHT, WIDTH], "counts": mask["counts"].decode("ascii")}
