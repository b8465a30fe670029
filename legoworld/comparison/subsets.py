"""The matches of some of an evaluation's images, as if only those had been evaluated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.matching.greedy import MatchTable
from legoworld.evaluation.detection.matching.matched_metrics import MatchedCounts


def table_of_images(table: MatchTable, kept: NDArray[np.bool_]) -> MatchTable:
    """The match table of the kept images.

    kept: (images,). Ranks, caps and LVIS's verified categories are per image, so nothing is matched
    again: the official evaluator gives the same on these images (checked by a test).
    """
    position = np.cumsum(kept) - 1
    rows, cells = kept[table.image], kept[table.truth_image]
    return replace(
        table,
        image_ids=table.image_ids[kept],
        image=position[table.image[rows]],
        category=table.category[rows],
        score=table.score[rows],
        rank=table.rank[rows],
        entry=table.entry[rows],
        state=np.ascontiguousarray(table.state[:, :, rows]),
        truth_image=position[table.truth_image[cells]],
        truth_category=table.truth_category[cells],
        n_truths=np.ascontiguousarray(table.n_truths[:, cells]),
    )


def counts_of_images(counts: MatchedCounts, kept: NDArray[np.bool_]) -> MatchedCounts:
    """The score-free sums of the kept images."""
    position = np.cumsum(kept) - 1
    cells = kept[counts.cell_image]
    return MatchedCounts(
        per_image=counts.per_image[kept],
        cell_image=position[counts.cell_image[cells]],
        cell_category=counts.cell_category[cells],
        cell_n_gt=counts.cell_n_gt[cells],
        cell_iou_sum=counts.cell_iou_sum[cells],
    )
