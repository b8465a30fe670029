"""Truths and predictions of amodal masks made for tests: stacks of random shapes."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from evaluation.detection_runs import text_counts
from pycocotools import mask as coco_mask

SIZE_WH = (120, 90)


def encoded(pixels: np.ndarray) -> dict[str, Any]:
    return text_counts(coco_mask.encode(np.asfortranarray(pixels, np.uint8)))


def decoded(mask: dict[str, Any]) -> np.ndarray:
    return coco_mask.decode({**mask, "counts": mask["counts"].encode()}).astype(bool)


def star(random: np.random.Generator) -> np.ndarray:
    angles = np.sort(random.random(9)) * 2 * np.pi
    centre = random.uniform([25, 25], [95, 65])
    points = centre + random.uniform(6, 34, 9)[:, None] * np.stack(
        [np.cos(angles), np.sin(angles)], axis=1
    )
    pixels = np.zeros(SIZE_WH[::-1], np.uint8)
    cv2.fillPoly(pixels, [np.round(points).astype(np.int32)], 1)
    return pixels.astype(bool)


def stacked(amodal: list[np.ndarray]) -> list[np.ndarray]:
    """The visible part of each, the first in front of all others."""
    taken, visible = np.zeros_like(amodal[0]), []
    for mask in amodal:
        visible.append(mask & ~taken)
        taken = taken | mask
    return visible


def annotation(image_id: int, category: int, amodal: np.ndarray, visible: np.ndarray) -> dict:
    return {
        "image_id": image_id,
        "category_id": category,
        "segmentation": encoded(amodal),
        "visible_mask": encoded(visible),
    }


def random_stacks(seed: int, images: int = 14) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """A truth, and predictions near and far from it, some of them below others than they should."""
    random = np.random.default_rng(seed)
    truth: dict[str, Any] = {
        "images": [
            {"id": 7 + 2 * i, "file_name": f"{i}.jpg", "width": SIZE_WH[0], "height": SIZE_WH[1]}
            for i in range(images)
        ],
        "annotations": [],
        "categories": [{"id": 5 + 2 * k, "name": f"thing {k}"} for k in range(3)],
    }
    found = []
    for image in truth["images"]:
        shapes = [star(random) for _ in range(int(random.integers(1, 6)))]
        if random.random() < 0.5:  # hidden wholly
            shapes.append(cv2.erode(shapes[0].astype(np.uint8), np.ones((5, 5))).astype(bool))
        shapes = [s for s in shapes if s.any()]
        categories = random.choice([5, 7, 9], len(shapes)).tolist()
        for category, mask, seen in zip(categories, shapes, stacked(shapes), strict=True):
            x, y, w, h = (int(v) for v in coco_mask.toBbox(coco_mask.encode(
                np.asfortranarray(mask, np.uint8))))  # fmt: skip
            truth["annotations"].append({
                **annotation(image["id"], category, mask, seen),
                "id": len(truth["annotations"]) + 1, "bbox": [x, y, w, h],
                "area": int(mask.sum()), "iscrowd": int(random.random() < 0.1),
            })  # fmt: skip
        order = random.permutation(len(shapes)) if random.random() < 0.4 else range(len(shapes))
        moved = [np.roll(shapes[i], random.integers(-2, 3, 2), (0, 1)) for i in order]
        moved += [star(random)]
        labels = [*(categories[i] for i in order), int(random.choice([5, 7, 9]))]
        for category, mask, seen in zip(labels, moved, stacked(moved), strict=True):
            entry = annotation(image["id"], int(category), mask, seen)
            found.append({**entry, "score": round(float(random.random()), 3)})
    return truth, found
