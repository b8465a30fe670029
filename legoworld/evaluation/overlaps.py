"""Overlaps of every image's detections and truths, by pycocotools' own IoU."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pycocotools import mask as coco_mask

from legoworld.evaluation.matching import ImageOverlaps
from legoworld.evaluation.predictions import Predictions
from legoworld.evaluation.problem import Problem
from legoworld.evaluation.truth import Truth


def image_overlaps(
    problem: Problem, truth: Truth, predictions: Predictions
) -> Iterator[ImageOverlaps]:
    """Images that have both detections and truths, in ascending id, one at a time."""
    detections, truths = problem.detections, problem.truths
    n = len(problem.image_ids)
    first_detection = np.searchsorted(detections.image, np.arange(n + 1))
    first_truth = np.searchsorted(truths.image, np.arange(n + 1))
    for i in range(n):
        mine = slice(int(first_detection[i]), int(first_detection[i + 1]))
        true = slice(int(first_truth[i]), int(first_truth[i + 1]))
        if mine.start == mine.stop or true.start == true.stop:
            continue
        entries = [predictions.entries[k] for k in detections.entry[mine]]
        annotations = [truth.annotations[k] for k in truths.annotation[true]]
        crowd = truths.crowd[true].astype(int).tolist()
        if problem.protocol.iou_type == "bbox":
            shapes = [e["bbox"] for e in entries], [a["bbox"] for a in annotations]
        else:
            size = truth.images[i]["height"], truth.images[i]["width"]
            shapes = (
                [_as_bytes(e["segmentation"]) for e in entries],
                [rle_of_truth(a["segmentation"], size) for a in annotations],
            )
        iou = np.asarray(coco_mask.iou(*shapes, crowd), np.float64)
        yield ImageOverlaps(image=i, detections=mine, truths=true, iou=iou)


def rle_of_truth(mask: Any, size_hw: tuple[int, int]) -> dict[str, Any]:
    """A truth's polygons or RLE as compressed RLE, the way annToRLE makes it."""
    if isinstance(mask, list):
        merged: dict[str, Any] = coco_mask.merge(coco_mask.frPyObjects(mask, *size_hw))
        return merged
    if isinstance(mask["counts"], list):
        compressed: dict[str, Any] = coco_mask.frPyObjects(mask, *size_hw)
        return compressed
    return _as_bytes(mask)


def _as_bytes(mask: dict[str, Any]) -> dict[str, Any]:
    return {"size": mask["size"], "counts": mask["counts"].encode("ascii")}
