"""All pixels pooled, as the official numbers are; the median is selected among all of them.

The counts of the rows say in which hundredth of a degree the middle of all errors lies, and how
many lie before it. A second reading of the arrays gives the errors there: sorted, the median is
among them, to the last bit and whoever read them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.normals.protocol import (
    ANGLES,
    ERROR_90,
    EXCLUDE,
    HOLE_DEG,
    METRICS,
    PER_DEGREE,
    THRESHOLDS_DEG,
    angular_metrics,
    bin_errors,
)
from legoworld.evaluation.pixels.family import F64, Options, SecondReading, Settings
from legoworld.evaluation.pixels.summary import means
from legoworld.records.normals import NormalsRow, NormalsSummary, ScoredNormalsRow
from legoworld.records.pixels import Means

_MEDIAN: Final = ANGLES[1]


@dataclass(frozen=True, kw_only=True)
class Middle:
    """Where the middle of all errors lies: the bins of its one or two places, and ranks there.

    holes: that count as errors of 90 degrees.
    """

    bins: tuple[int, int]
    ranks: tuple[int, int]
    holes: int


def own_fields(
    _rows: Sequence[NormalsRow], scored: Sequence[ScoredNormalsRow], settings: Settings
) -> Mapping[str, Any]:
    """The fields of a summary that only normals have."""
    return {
        "pooled": _pool_metrics(scored, cast("Mapping[str, float]", settings.options["medians"])),
        "pooled_px": sum(row.n_valid for row in scored),
        "predicted_px": sum(row.errors.n for row in scored),
    }


def _pool_metrics(scored: Sequence[ScoredNormalsRow], medians: Mapping[str, float]) -> Means:
    if not scored:
        return means([], METRICS)
    images = [row.errors for row in scored]
    pooled = angular_metrics(
        sum(image.n for image in images),
        math.fsum(image.sum_deg for image in images),
        math.fsum(image.sum_deg2 for image in images),
        [sum(image.below[k] for image in images) for k in range(len(THRESHOLDS_DEG))],
        _holes(scored),
        {
            policy: value if _is_within(value, middle) else math.nan
            for policy, middle in _middles(scored).items()
            for value in (medians.get(policy, math.nan),)
        },
    )
    return {name: {**values} for name, values in pooled.items()}


def _is_within(median_deg: float, middle: Middle) -> bool:
    """Whether a median can be that of errors in these bins: the counts alone say so much."""
    return abs(2 * median_deg * PER_DEGREE - sum(middle.bins)) <= 1.0 + 1e-9


def _holes(scored: Sequence[ScoredNormalsRow]) -> int:
    return sum(row.n_valid - row.errors.n for row in scored)


def _middles(scored: Sequence[ScoredNormalsRow]) -> dict[str, Middle]:
    """By policy, where the median lies; none without a scored image."""
    if not scored:
        return {}
    counts = np.zeros(180 * PER_DEGREE + 1, np.int64)
    for row in scored:
        unpacked = _unpack_zeros(row.errors.counts)
        counts[: len(unpacked)] += unpacked
    found = {EXCLUDE: _middle(counts, 0)}
    counts[round(HOLE_DEG * PER_DEGREE)] += _holes(scored)
    found[ERROR_90] = _middle(counts, _holes(scored))
    return found


def _middle(counts: NDArray[np.int64], holes: int) -> Middle:
    ends = np.cumsum(counts)
    n = int(ends[-1])
    places = ((n - 1) // 2, n // 2)
    low, high = (int(np.searchsorted(ends, place, side="right")) for place in places)
    first, second = (
        place - int(ends[k] - counts[k]) for place, k in zip(places, (low, high), strict=True)
    )
    return Middle(bins=(low, high), ranks=(first, second), holes=holes)


def _bins(scored: Sequence[ScoredNormalsRow]) -> Options:
    """The question: the hundredths of a degree that the medians lie in."""
    return {"bins": sorted({k for middle in _middles(scored).values() for k in middle.bins})}


def _medians(scored: Sequence[ScoredNormalsRow], images: Sequence[F64]) -> Options:
    """The exact median by policy, from the errors in these bins."""
    errors = np.sort(np.concatenate([np.empty(0), *images]))
    bins = bin_errors(errors)
    found: dict[str, float] = {}
    for policy, middle in _middles(scored).items():
        low, high = (
            _select_rank(errors[bins == k], rank, middle.holes if k == HOLE_DEG * PER_DEGREE else 0)
            for k, rank in zip(middle.bins, middle.ranks, strict=True)
        )
        found[policy] = (low + high) / 2
    return {"medians": found}


def _select_rank(errors: F64, rank: int, holes: int) -> float:
    """The rank-th of sorted errors, among which holes stand at 90 degrees."""
    before = int(np.searchsorted(errors, HOLE_DEG))
    if before <= rank < before + holes:
        return HOLE_DEG
    return float(errors[rank if rank < before else rank - holes])


def _recall_medians(summary: NormalsSummary) -> Options:
    return {"medians": {p: v for p, v in summary.pooled[_MEDIAN].items() if v is not None}}


def _unpack_zeros(packed: Sequence[int]) -> NDArray[np.int64]:
    values = np.array(packed, np.int64)
    lengths = np.where(values < 0, -values, 1)
    return np.repeat(np.maximum(values, 0), lengths)


MEDIAN: Final = SecondReading(question=_bins, conclude=_medians, recall=_recall_medians)
