"""Greedy matching as pycocotools and lvis do it, for all areas and thresholds at once.

`evaluate` holds the numbers that follow from these matches to the evaluator's own on every run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.problem import (
    Bools,
    Detections,
    Floats,
    Ints,
    Problem,
    TrueInstances,
)
from legoworld.evaluation.protocols import AREA_RANGES, IOU_THRESHOLDS

#: What became of a detection at an area range and a threshold.
FALSE_POSITIVE, TRUE_POSITIVE, IGNORED = 0, 1, 2

_THRESHOLDS = np.minimum(IOU_THRESHOLDS, 1 - 1e-10)
_LOW, _HIGH = np.array(AREA_RANGES).T


@dataclass(frozen=True, kw_only=True)
class MatchTable:
    """What became of every scored detection; enough for every AP and AR without matching again.

    Detections are ordered by category, falling score, image, rank: the order precision and
    recall are accumulated in. state: (A, T, D) uint8 of FALSE_POSITIVE, TRUE_POSITIVE, IGNORED;
    image, category, score, rank, entry: (D,) as in Detections. n_truths: (A, N) scored truth
    instances of the N cells (truth_image, truth_category) that have any.
    """

    image_ids: Ints
    category_ids: Ints
    image: Ints
    category: Ints
    score: Floats
    rank: Ints
    entry: Ints
    state: NDArray[np.uint8]
    truth_image: Ints
    truth_category: Ints
    n_truths: Ints


@dataclass(frozen=True, kw_only=True)
class ImageOverlaps:
    """One image of a chunk: positions of its detections and truths there, and their overlaps.

    iou: (detections, truths); for a crowd truth, the share of the detection inside it.
    """

    image: int
    detections: slice
    truths: slice
    iou: Floats


def unmatched(detections: Detections) -> NDArray[np.uint8]:
    """(A, T, D) state of detections in which nothing has matched yet."""
    shape = len(AREA_RANGES), len(_THRESHOLDS), len(detections.image)
    return np.full(shape, FALSE_POSITIVE, np.uint8)


def greedy(iou: Floats, ignored: Bools, crowd: Bools) -> tuple[Bools, Bools]:
    """(matched, matched to an ignored truth), each (A, T, D).

    iou: (D, G), detections by falling score, truths in file order; ignored: (A, G);
    crowd: (G,), truths that any number of detections may match.
    """
    lanes = (len(ignored), len(_THRESHOLDS))
    matched, to_ignored = np.zeros((2, *lanes, len(iou)), bool)
    free = np.ones((*lanes, iou.shape[1]), bool)
    regular = ~ignored[:, None, :]
    for d in np.flatnonzero((iou >= _THRESHOLDS[0]).any(axis=1)):
        reached = free & (iou[d] >= _THRESHOLDS[:, None])
        # A regular truth is always preferred; of equal overlaps the later truth wins.
        preferred = reached & regular
        use = np.where(preferred.any(axis=2)[..., None], preferred, reached)
        best = iou.shape[1] - 1 - np.argmax(np.where(use, iou[d], -1.0)[..., ::-1], axis=2)
        hit = use.any(axis=2)
        matched[..., d] = hit
        to_ignored[..., d] = hit & np.take_along_axis(ignored, best, axis=1)
        a, t = np.nonzero(hit & ~crowd[best])
        free[a, t, best[a, t]] = False
    return matched, to_ignored


def match_image(
    detections: Detections, truths: TrueInstances, found: ImageOverlaps, state: NDArray[np.uint8]
) -> None:
    """Write what becomes of one image's detections into the state."""
    first = found.detections.start
    categories = detections.category[found.detections]
    true_categories = truths.category[found.truths]
    area = truths.area[found.truths]
    outside = (area < _LOW[:, None]) | (area > _HIGH[:, None])
    ignored = truths.ignored[found.truths] | outside
    crowd = truths.crowd[found.truths]
    for category in np.intersect1d(categories, true_categories):
        rows = np.flatnonzero(categories == category)
        columns = np.flatnonzero(true_categories == category)
        matched, to_ignored = greedy(
            found.iou[np.ix_(rows, columns)], ignored[:, columns], crowd[columns]
        )
        kinds = np.where(to_ignored, IGNORED, np.where(matched, TRUE_POSITIVE, FALSE_POSITIVE))
        state[:, :, first + rows] = kinds


def ignore_unmatched(detections: Detections, area: Floats, state: NDArray[np.uint8]) -> None:
    """Forgive unmatched detections outside the area range, or where LVIS did not annotate all.

    area: (D,) of the detections; state: once every image is matched.
    """
    for a, (low, high) in enumerate(AREA_RANGES):
        forgiven = (area < low) | (area > high) | ~detections.exhaustive
        lane = state[a]
        lane[(lane == FALSE_POSITIVE) & forgiven] = IGNORED


def match_table(problem: Problem, state: NDArray[np.uint8]) -> MatchTable:
    """The table of a whole state; unverified detections take no part."""
    detections, truths = problem.detections, problem.truths
    order = np.lexsort((detections.rank, detections.image, -detections.score, detections.category))
    order = order[detections.verified[order]]
    n_categories = len(problem.category_ids)
    cells, cell = np.unique(truths.image * n_categories + truths.category, return_inverse=True)
    counts = np.zeros((len(AREA_RANGES), len(cells)), np.int64)
    for a, (low, high) in enumerate(AREA_RANGES):
        scored = ~truths.ignored & (truths.area >= low) & (truths.area <= high)
        counts[a] = np.bincount(cell[scored], minlength=len(cells))
    some = counts.any(axis=0)
    return MatchTable(
        image_ids=problem.image_ids,
        category_ids=problem.category_ids,
        image=detections.image[order],
        category=detections.category[order],
        score=detections.score[order],
        rank=detections.rank[order],
        entry=detections.entry[order],
        state=np.ascontiguousarray(state[:, :, order]),
        truth_image=cells[some] // n_categories,
        truth_category=cells[some] % n_categories,
        n_truths=np.ascontiguousarray(counts[:, some]),
    )
