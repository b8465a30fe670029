"""Overlaps and areas of a chunk's shapes: of boxes by pycocotools' own function, of masks by ours.

Mask overlaps are ratios of integers, and so independent of the implementation.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from legoworld.evaluation.detection.inputs.masks import compressed, joined_texts, measured, overlaps
from legoworld.evaluation.detection.matching.chunks import Chunk
from legoworld.evaluation.detection.problem import Floats
from legoworld.evaluation.kernels.library import check, library, pointer


@dataclass(frozen=True, kw_only=True)
class Overlaps:
    """iou: (detections, truths) of every image that has both, one after the other, flat.

    IoU; for a crowd truth, the share of the detection inside it. area: (D,) what the evaluators
    take for a detection's area: of the box, or of the mask.
    """

    iou: Floats
    area: Floats


def overlaps_of(chunk: Chunk) -> Overlaps:
    """Of every image of a chunk."""
    if chunk.iou_type == "bbox":
        return Overlaps(iou=_of_boxes(chunk), area=chunk.boxes[:, 2] * chunk.boxes[:, 3])
    _, area = measured(chunk.masks)
    return Overlaps(iou=_of_masks(chunk), area=area)


def _of_boxes(chunk: Chunk) -> Floats:
    first_detection, first_truth = chunk.first_detection.tolist(), chunk.first_truth.tolist()
    crowd = chunk.truths.crowd.astype(int).tolist()
    ious = []
    for i in range(len(chunk.sizes_hw)):
        mine = slice(first_detection[i], first_detection[i + 1])
        true = slice(first_truth[i], first_truth[i + 1])
        if mine.start < mine.stop and true.start < true.stop:
            ious.append(overlaps(chunk.boxes[mine], chunk.true_boxes[true], crowd[true]))
    return np.concatenate([*(iou.ravel() for iou in ious), np.empty(0)])


def _of_masks(chunk: Chunk) -> Floats:
    first_detection, first_truth = chunk.first_detection, chunk.first_truth
    iou = np.empty(int((np.diff(first_detection) * np.diff(first_truth)).sum()))
    height = np.array([h for h, _ in chunk.sizes_hw], np.int64)
    sizes_hw = [chunk.sizes_hw[i] for i in chunk.truths.image.tolist()]
    wanted = zip(chunk.true_masks, sizes_hw, strict=True)
    true_texts = [compressed(mask, size_hw)["counts"] for mask, size_hw in wanted]
    texts, start = joined_texts([text.encode("ascii") for text in chunk.masks])
    true_text, true_start = joined_texts(true_texts)
    crowd = np.ascontiguousarray(chunk.truths.crowd)
    done = library().lw_overlap_masks(
        ctypes.c_char_p(texts), pointer(start), ctypes.c_char_p(true_text), pointer(true_start),
        pointer(first_detection), pointer(first_truth), pointer(height),
        ctypes.c_int64(len(height)), pointer(crowd), pointer(iou),
    )  # fmt: skip
    check(done)
    return iou
