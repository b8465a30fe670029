"""The evaluators' caps on the number of predictions per image."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.inputs.prediction_columns import PredictionColumns


def rank_in_group(sorted_groups: NDArray[np.int64]) -> NDArray[np.int64]:
    """Position in its run of equal values, from 0."""
    if not len(sorted_groups):
        return np.empty(0, np.int64)
    starts = np.flatnonzero(np.diff(sorted_groups, prepend=sorted_groups[0] - 1))
    sizes = np.diff(starts, append=len(sorted_groups))
    return np.arange(len(sorted_groups)) - np.repeat(starts, sizes)


def without_empty(
    entries: PredictionColumns,
    empty: NDArray[np.bool_],
    cap: int | None,
    warnings: Counter[str],
) -> PredictionColumns:
    """The entries that have a pixel, and that lvis keeps beside those that have none.

    lvis counts masks without a pixel among an image's first `cap` and drops them afterwards: what
    they push over the cap is dropped here, because evaluation no longer sees them.
    """
    kept = ~empty
    if cap is not None:
        image, score = entries.image_id, entries.score.astype(np.float64)
        crowded = np.isin(image, image[empty])
        by_rank = np.lexsort((np.arange(len(entries)), -score, image))
        within = np.empty(len(entries), bool)
        within[by_rank] = rank_in_group(image[by_rank]) < cap
        pushed = kept & crowded & ~within
        if pushed.any():
            warnings["masks lost to the cap beside masks without a pixel"] = int(pushed.sum())
        kept &= ~pushed
    return entries.take(np.flatnonzero(kept))
