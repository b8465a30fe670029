"""Several systems over the same images: ranks and differences, all of the same draws."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.family import load_comparison_family
from legoworld.comparison.measures import IntervalRule, Metric
from legoworld.evaluation.bootstrap import LEVEL
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.records.bench_results import Rank
from legoworld.records.comparison import ComparisonSettings
from legoworld.records.evaluation import Interval

F64 = NDArray[np.float64]
Differences = dict[tuple[int, int], tuple[float, Interval | None]]


@dataclass(frozen=True, kw_only=True)
class RankedSides:
    """Sides by one metric over all attempted images. unit: what the draws draw.

    values: (sides,), NaN where undefined; differences: of every two, in both orders.
    """

    metric: Metric
    unit: str
    values: F64
    ranks: tuple[Rank, ...]
    differences: Differences


def rank_sides(
    sides: Sequence[StoredEvaluation], metric_id: str, settings: ComparisonSettings
) -> RankedSides | None:
    """Rank evaluations of one ground truth by a metric; None if one lacks it."""
    family = load_comparison_family(sides[0].task)
    kept = family.unpaired(sides[0])
    metric = next(m for m in family.metrics(sides[0].task) if m.id == metric_id)
    images = family.images[0]
    if not kept.any():
        return None
    measurer = family.measurer(sides[0], images, kept, settings)
    measured = [measurer(side).get(metric_id) for side in sides]
    found = [one for one in measured if one is not None]
    if len(found) < len(sides):
        return None
    unit = family.unit(sides[0])
    rule = IntervalRule(centred=family.centred, unit=unit)
    values = np.array([one.value for one in found], np.float64)
    samples = [one.samples for one in found]
    drawn = np.array([s for s in samples if s is not None])
    sign = 1.0 if metric.better == "higher" else -1.0
    whole = len(drawn) == len(found)
    return RankedSides(
        metric=metric,
        unit=unit,
        values=values,
        ranks=tuple(rank_systems(sign * values, sign * drawn if whole else None)),
        differences=paired_differences(
            permutations(range(len(found)), 2),
            values,
            drawn if whole else None,
            lambda samples, value: rule.interval(samples, value, least=-1.0),
        ),
    )


def paired_differences(
    pairs: Iterable[tuple[int, int]],
    values: F64,
    resampled: F64 | None,
    interval: Callable[[F64, float], Interval | None],
) -> Differences:
    """The first minus the second of each pair, with the interval of its (draws,)."""
    found: Differences = {}
    for i, j in pairs:
        value = float(values[i] - values[j])
        drawn = None if resampled is None else resampled[i] - resampled[j]
        found[i, j] = value, None if drawn is None else interval(drawn, value)
    return found


def rank_systems(values: F64, resampled: F64 | None) -> Iterator[Rank]:
    """1 for the highest; equal values share the better rank, undefined ones the last.

    values: (systems,); resampled: (systems, draws), None for ranks without intervals.
    """
    ranks = 1 + _above(values).sum(axis=1)
    if resampled is None:
        yield from (Rank(rank=int(rank), low=None, high=None) for rank in ranks)
        return
    drawn = np.nan_to_num(resampled, nan=-np.inf)
    tail = (1 - LEVEL) / 2
    for own, rank in zip(drawn, ranks, strict=True):
        of_draws = 1 + (drawn > own).sum(axis=0)
        low, high = np.quantile(of_draws, [tail, 1 - tail], method="inverted_cdf")
        yield Rank(rank=int(rank), low=int(low), high=int(high))


def _above(values: F64) -> NDArray[np.bool_]:
    """(systems, systems): whether the second is above the first."""
    known = np.nan_to_num(values, nan=-np.inf)
    above: NDArray[np.bool_] = known[None, :] > known[:, None]
    return above
