"""matches.npz: the data for comparison, intervals and evidence without matching again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.matching.greedy import MatchTable
from legoworld.evaluation.detection.matching.matched_metrics import MatchedCounts
from legoworld.evaluation.detection.scoring import RankedScore, Score

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
