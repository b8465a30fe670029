"""Chunks of detections and truths that matching and pairing are given by hand."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike

from legoworld.evaluation.detection.matching.matches import Chunk, pair_chunk
from legoworld.evaluation.detection.payloads.boxes import BOXES
from legoworld.evaluation.detection.payloads.payload import Overlaps
from legoworld.evaluation.detection.problem import Detections, TrueInstances


def chunk_of(
    found: list[list[int]],
    wanted: list[list[int]],
    *,
    unverified: ArrayLike = False,
    not_exhaustive: ArrayLike = False,
    ignored: ArrayLike = False,
    crowd: ArrayLike = False,
    area: ArrayLike = 0.0,
) -> Chunk:
    """Categories of each image's detections (ascending) and truths; what is odd of each.

    unverified holds for categories that no truth of the image is of.
    """
    image, true_image = (
        np.repeat(np.arange(len(found)), [len(x) for x in side]) for side in (found, wanted)
    )
    n, g = len(image), len(true_image)
    present = np.array([c in wanted[i] for i, cs in enumerate(found) for c in cs], bool)
    zeros = np.zeros(n, np.int64)
    return Chunk(
        payload=BOXES,
        detections=Detections(
            image=image,
            category=np.array(list(itertools.chain(*found)), np.int64),
            score=np.zeros(n),
            rank=zeros,
            entry=zeros,
            verified=present | ~np.broadcast_to(unverified, n),
            exhaustive=~np.broadcast_to(not_exhaustive, n),
        ),
        truths=TrueInstances(
            image=true_image,
            category=np.array(list(itertools.chain(*wanted)), np.int64),
            area=np.array(np.broadcast_to(area, g), np.float64),
            ignored=np.array(np.broadcast_to(ignored, g), bool),
            crowd=np.array(np.broadcast_to(crowd, g), bool),
            annotation=np.zeros(g, np.int64),
        ),
        first_detection=np.searchsorted(image, np.arange(len(found) + 1)),
        first_truth=np.searchsorted(true_image, np.arange(len(found) + 1)),
        sizes_hw=((9, 9),) * len(found),
        shapes=np.empty((0, 4)),
        true_shapes=np.empty((0, 4)),
    )


def best_pairs(iou, same_label):
    """Rows and columns of the pairs of one image across categories."""
    chunk = chunk_of([[0] * iou.shape[0]], [[0] * iou.shape[1]])
    assert same_label.any() == same_label.all() or same_label.shape == (2, 2)
    if same_label.any():  # two labels, the second row's and column's another
        turned = not same_label[0, 0]
        chunk.detections.category[:] = [0, 1]
        chunk.truths.category[:] = [1, 0] if turned else [0, 1]
    else:
        chunk.truths.category[:] = 1
    overlaps = Overlaps(iou=iou.ravel(), area=np.zeros(len(iou)))
    pairs = pair_chunk(chunk, overlaps, class_aware=False)
    return pairs.detection, pairs.truth
