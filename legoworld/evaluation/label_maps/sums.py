"""Sums of rows by category, and the metrics of bootstrap samples of their images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.bootstrap import weighted_sums
from legoworld.evaluation.label_maps.family import F64, MapFamily
from legoworld.records.label_maps import LabelMapRow


def present_categories(rows: Sequence[LabelMapRow]) -> list[int]:
    """The category ids that a row has, ascending."""
    return sorted({int(number) for row in rows for number in row.counts})


def total_sums(rows: Sequence[LabelMapRow], category_ids: Sequence[int]) -> F64:
    """(K, 4): the sum of IoU and of the three counts of each category.

    IoU is added match by match in the rows' order, as panopticapi adds it in one process, so that
    the sum is the same to the last bit.
    """
    place = {number: k for k, number in enumerate(category_ids)}
    sums = np.zeros((len(category_ids), 4))
    for row in rows:
        for number, counts in row.counts.items():
            sums[place[int(number)], 1:] += counts
        for match in row.matched:
            sums[place[match.category_id], 0] += match.intersection / match.union
    return sums


def resample_values(
    family: MapFamily,
    rows: Sequence[LabelMapRow],
    category_ids: Sequence[int],
    things: NDArray[np.bool_],
    counts: NDArray[np.int32],
) -> dict[str, F64]:
    """(draws,) of each metric over bootstrap samples. counts: (draws, rows)."""
    sums = np.zeros((len(counts), len(category_ids), 4))
    for k, number in enumerate(category_ids):
        of = [n for n, row in enumerate(rows) if str(number) in row.counts]
        alone = np.stack([total_sums([_only(rows[n], number)], [number])[0] for n in of])
        drawn = counts[:, of]
        for column in range(4):
            if alone[:, column].any():
                sums[:, k, column] = weighted_sums(drawn, alone[:, column])
    return family.values(sums, things)


def _only(row: LabelMapRow, number: int) -> LabelMapRow:
    from msgspec.structs import replace

    return replace(
        row,
        counts={str(number): row.counts[str(number)]},
        matched=tuple(m for m in row.matched if m.category_id == number),
    )


def average_defined(values: F64, defined: NDArray[np.bool_]) -> F64:
    """The mean over the last axis (..., K) of what is defined, added in order; NaN of nothing."""
    kept = np.where(defined, values, 0.0)
    return ratio(in_order(kept), defined.sum(axis=-1))


def in_order(values: F64) -> F64:
    """(...) sums over the last axis of (..., K), added from first to last; 0 of nothing."""
    total: F64 = np.add.accumulate(values, axis=-1)[..., -1:].sum(axis=-1)
    return total


def ratio(part: F64, whole: F64) -> F64:
    """part / whole of one shape, NaN where whole is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(whole != 0, part / np.where(whole != 0, whole, 1.0), np.nan)
