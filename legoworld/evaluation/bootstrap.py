"""Bootstrap draws over groups (images, or scenes), shared by every score and comparison."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from legoworld.errors import UsageError
from legoworld.pluralize import plural
from legoworld.records.evaluation import Interval

LEVEL: Final = 0.95
#: Maximum number of elements in one product of counts and values, to bound memory.
_BLOCK_ELEMENTS: Final = 1 << 18


def check_draws(draws: int, seed: int) -> None:
    """Raise UsageError for a bootstrap that cannot be drawn."""
    if draws < 1 or seed < 0:
        raise UsageError(
            "invalid bootstrap settings",
            found=f"{plural(draws, 'draw', 'draws')}, seed {seed}",
            expected="at least one draw, and a seed of at least 0",
        )


def resample_counts(n_groups: int, draws: int, seed: int) -> NDArray[np.int32]:
    """How often each group is in each bootstrap sample: (draws, n_groups), rows sum to n_groups.

    Row k depends on n_groups, seed and k alone, so more draws extend fewer, and two methods
    resampled over the same groups share their samples (paired differences). UsageError for no
    group, no draw or a seed below 0.
    """
    if n_groups < 1 or draws < 1 or seed < 0:
        raise UsageError(
            "invalid bootstrap settings",
            found=f"{n_groups} groups, {plural(draws, 'draw', 'draws')}, seed {seed}",
            expected="at least one group and one draw, and a seed of at least 0",
        )
    random = np.random.default_rng([seed, n_groups])
    counts = np.empty((draws, n_groups), np.int32)
    rows = max(1, _BLOCK_ELEMENTS // n_groups)
    for start in range(0, draws, rows):
        some = counts[start : start + rows]
        drawn = random.integers(0, n_groups, some.shape)  # the numbers of as many calls for a row
        drawn += n_groups * np.arange(len(some))[:, None]
        some[:] = np.bincount(drawn.ravel(), minlength=some.size).reshape(some.shape)
    return counts


def resampled_means(
    values: NDArray[np.float64], group_of_value: NDArray[np.int64], counts: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Mean of values in each bootstrap sample of their groups: (draws,).

    values: (n,), finite; group_of_value: (n,) column of `counts`. Each value is weighted by how
    often its group was drawn. NaN where no value was drawn.
    """
    n_groups = counts.shape[1]
    sums = np.bincount(group_of_value, weights=values, minlength=n_groups)
    sizes = np.bincount(group_of_value, minlength=n_groups)
    with np.errstate(invalid="ignore", divide="ignore"):
        means: NDArray[np.float64] = weighted_sums(counts, sums) / weighted_sums(counts, sizes)
    return means


@dataclass(frozen=True, kw_only=True)
class GroupDraws:
    """Bootstrap draws over named groups, such as scenes, shared by every number over them.

    counts: (draws, groups) how often each group is in each sample; column: of each group.
    """

    counts: NDArray[np.int32]
    column: dict[str, int]

    @property
    def spread(self) -> bool:
        """Whether there are several groups: one alone shows none."""
        return len(self.column) > 1

    def means(self, values: NDArray[np.float64], groups: Iterable[str]) -> NDArray[np.float64]:
        """(draws,) means of the values, each weighted by how often its group was drawn."""
        columns = np.array([self.column[group] for group in groups], np.int64)
        return resampled_means(values, columns, self.counts)


def draw_groups(groups: Iterable[str], draws: int, seed: int) -> GroupDraws:
    """Draws over the distinct groups, in the order of their names."""
    names = sorted(set(groups))
    counts = resample_counts(len(names), draws, seed) if names else np.empty((draws, 0), np.int32)
    return GroupDraws(counts=counts, column={name: k for k, name in enumerate(names)})


def weighted_sums(counts: NDArray[np.int32], values: NDArray[Any]) -> NDArray[np.float64]:
    """counts @ values, (draws,), with NumPy's own summation: BLAS products differ by machine."""
    sums = np.empty(len(counts))
    rows = max(1, _BLOCK_ELEMENTS // counts.shape[1])
    for start in range(0, len(counts), rows):
        some = counts[start : start + rows]
        sums[start : start + rows] = np.add.reduce(some * values.astype(np.float64), axis=1)
    return sums


def centred_interval(
    samples: NDArray[np.float64], value: float, *, unit: str, least: float = 0.0
) -> Interval:
    """The interval of a metric in [`least`, 1] whose bootstrap samples are biased.

    Average precision over resampled images is biased upwards: a category whose image is drawn
    twice has its true positives doubled, one that is not drawn at all leaves the mean. The samples
    are shifted onto the value before the percentiles are taken; `bootstrap_mean` is the mean before
    the shift. samples: (draws,). value: NaN where the metric is undefined.
    """
    mean = float(np.mean(samples[~np.isnan(samples)])) if not np.isnan(samples).all() else np.nan
    around = interval(samples - mean + value, unit=unit)
    low, high = (None if e is None else min(1.0, max(least, e)) for e in (around.low, around.high))
    return replace(around, low=low, high=high, bootstrap_mean=None if np.isnan(mean) else mean)


def interval(samples: NDArray[np.float64], *, unit: str) -> Interval:
    """The percentile interval of a metric's bootstrap samples, as in summary.json.

    samples: (draws,), NaN where the metric is undefined in a sample: these are left out and
    counted. low and high are None if all samples are NaN.
    """
    defined = samples[~np.isnan(samples)]
    low = high = None
    if len(defined):
        low, high = (float(x) for x in np.quantile(defined, [(1 - LEVEL) / 2, (1 + LEVEL) / 2]))
    return Interval(
        low=low,
        high=high,
        level=LEVEL,
        unit=unit,
        draws=len(samples),
        undefined_draws=len(samples) - len(defined),
    )
