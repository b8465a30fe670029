"""The outcome of every detection as pycocotools and lvis match them, and the arrays of matches.npz.

matches.npz: the data for comparison, intervals and evidence without matching again.
`evaluate` holds the numbers that follow from these matches to the evaluator's own on every run.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.matching.matched_metrics import MatchedCounts
from legoworld.evaluation.detection.problem import Floats, Ints, Problem

if TYPE_CHECKING:
    from legoworld.evaluation.detection.scoring import RankedScore, Score

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


Arrays = Mapping[str, NDArray[Any]]

#: Policies: the predictions' own scores, and all scores equal. The second is stored only where it
#: differs from the first.
OWN, EQUAL = "", "equal_"

_COUNTS: Final = ("per_image", "cell_image", "cell_category", "cell_n_gt", "cell_iou_sum")
_TABLE: Final = (
    "image",
    "category",
    "score",
    "rank",
    "entry",
    "state",
    "truth_image",
    "truth_category",
    "n_truths",
)


def pack_matches(score: Score, equal: RankedScore | None) -> dict[str, NDArray[Any]]:
    """Everything matches.npz holds, shapes as in `MatchTable` and `MatchedCounts`.

    Positions point into image_ids and category_ids.
    """
    grid = score.problem.protocol.grid
    arrays: dict[str, NDArray[Any]] = {
        "image_ids": score.table.image_ids,
        "category_ids": score.table.category_ids,
        "iou_thresholds": grid.iou,
        f"area_ranges_{grid.unit}": np.array(grid.ranges),
    }
    ranked: tuple[tuple[str, RankedScore | None], ...] = ((OWN, score), (EQUAL, equal))
    for prefix, one in ranked:
        if one is not None:
            arrays |= {prefix + name: getattr(one.table, name) for name in _TABLE}
    for prefix, counts in (("aware_", score.aware), ("agnostic_", score.agnostic)):
        arrays |= {prefix + name: getattr(counts, name) for name in _COUNTS}
    return arrays


def table_from(arrays: Arrays, policy: str = OWN) -> MatchTable:
    """A policy's (A, T, D) match table; the equal one is the own where that was equal already."""
    prefix = policy if policy + "state" in arrays else OWN
    return MatchTable(
        image_ids=arrays["image_ids"],
        category_ids=arrays["category_ids"],
        **{name: arrays[prefix + name] for name in _TABLE},
    )


def counts_from(arrays: Arrays, *, class_aware: bool) -> MatchedCounts:
    """The sums of the score-free numbers, shapes as in `MatchedCounts`."""
    prefix = "aware_" if class_aware else "agnostic_"
    return MatchedCounts(**{name: arrays[prefix + name] for name in _COUNTS})
