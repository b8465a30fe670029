"""Overlaps of every image's detections and truths, by pycocotools' own IoU."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from legoworld.evaluation.masks import compressed, overlaps
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
                [compressed(e["segmentation"], size) for e in entries],
                [compressed(a["segmentation"], size) for a in annotations],
            )
        iou = overlaps(*shapes, crowd)
        yield ImageOverlaps(image=i, detections=mine, truths=true, iou=iou)
