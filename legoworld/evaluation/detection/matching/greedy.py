"""Greedy matching as pycocotools and lvis do it, for all areas and thresholds at once.

`evaluate` holds the numbers that follow from these matches to the evaluator's own on every run.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.problem import Floats, Ints, Problem

#: The outcome of a detection at an area range and a threshold.
FALSE_POSITIVE, TRUE_POSITIVE, IGNORED = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class MatchTable:
    """The outcome of every scored detection; sufficient for every AP and AR without matching again.

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

    @property
    def category_slices(self) -> list[slice]:
        """Where each category's detections lie in the table."""
        edges = np.searchsorted(self.category, np.arange(len(self.category_ids) + 1))
        return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]

    @property
    def truths_per_category(self) -> Ints:
        """(A, K) scored truth instances."""
        n = len(self.category_ids)
        return np.stack(
            [np.bincount(self.truth_category, weights=row, minlength=n) for row in self.n_truths]
        ).astype(np.int64)


def match_table(problem: Problem, state: NDArray[np.uint8]) -> MatchTable:
    """The table of a whole state, (A, T, D); unverified detections take no part."""
    detections, truths = problem.detections, problem.truths
    order = np.lexsort((detections.rank, detections.image, -detections.score, detections.category))
    order = order[detections.verified[order]]
    n_categories, ranges = len(problem.category_ids), problem.protocol.grid.ranges
    cells, cell = np.unique(truths.image * n_categories + truths.category, return_inverse=True)
    counts = np.zeros((len(ranges), len(cells)), np.int64)
    for a, (low, high) in enumerate(ranges):
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
