"""Overlaps and areas of a chunk's shapes, by pycocotools' own functions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from legoworld.evaluation.chunks import Chunk
from legoworld.evaluation.masks import Rle, Shapes, areas_px, compressed, overlaps
from legoworld.evaluation.matching import ImageOverlaps
from legoworld.evaluation.problem import Floats


def image_overlaps(chunk: Chunk) -> Iterator[ImageOverlaps]:
    """Images that have both detections and truths, in ascending order, one at a time."""
    images = np.arange(len(chunk.sizes_hw) + 1)
    first_detection = np.searchsorted(chunk.detections.image, images)
    first_truth = np.searchsorted(chunk.truths.image, images)
    for i, size_hw in enumerate(chunk.sizes_hw):
        mine = slice(int(first_detection[i]), int(first_detection[i + 1]))
        true = slice(int(first_truth[i]), int(first_truth[i + 1]))
        if mine.start == mine.stop or true.start == true.stop:
            continue
        found: Shapes
        wanted: Shapes
        if chunk.iou_type == "bbox":
            found, wanted = chunk.boxes[mine], chunk.true_boxes[true]
        else:
            found = [_mask(counts, size_hw) for counts in chunk.masks[mine]]
            wanted = [compressed(mask, size_hw) for mask in chunk.true_masks[true]]
        crowd = chunk.truths.crowd[true].astype(int).tolist()
        iou = overlaps(found, wanted, crowd)
        yield ImageOverlaps(image=i, detections=mine, truths=true, iou=iou)


def detection_areas(chunk: Chunk) -> Floats:
    """(D,) what the evaluators take for a detection's area: of the box, or of the mask."""
    if chunk.iou_type == "bbox":
        return np.asarray(chunk.boxes[:, 2] * chunk.boxes[:, 3])
    images = chunk.detections.image.tolist()
    return areas_px([_mask(c, chunk.sizes_hw[i]) for c, i in zip(chunk.masks, images, strict=True)])


def _mask(counts: str, size_hw: tuple[int, int]) -> Rle:
    return {"size": list(size_hw), "counts": counts.encode("ascii")}
