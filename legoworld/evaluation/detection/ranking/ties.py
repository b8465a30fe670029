"""AP over random tie-breaking orders of equally confident detections, and its bounds.

The matches stay as they are (docs/protocols/ties.md); only the ranking of equally confident
detections of a category changes. One order of a category's detections serves all IoU thresholds.
orders.cpp draws the orders with NumPy's own distributions.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import InstallationError
from legoworld.evaluation.detection.matching.outcomes import (
    FALSE_POSITIVE,
    IGNORED,
    TRUE_POSITIVE,
    MatchTable,
)
from legoworld.evaluation.detection.problem import Floats, Ints
from legoworld.evaluation.detection.ranking.accumulation import mean_precision, recall_steps
from legoworld.evaluation.detection.ranking.compiled_accumulation import (
    ordered_precision,
    pack_bits,
)
from legoworld.evaluation.kernels.library import call, pointer, pointers
from legoworld.records.base import number
from legoworld.records.detection import Ties
from legoworld.workers.processors import core_threads

Counts = NDArray[np.int32]

#: numpy's manual, "Extending": the functions of distributions.h, from the module that holds them.
_DISTRIBUTIONS: Final = (
    "random_standard_uniform_fill_f",
    "random_standard_exponential_fill",
    "random_multinomial",
)
#: Elements of one block of random orders, to bound memory: part of what a seed means.
_BLOCK_ELEMENTS: Final = 1 << 21


class _RandomStruct(ctypes.Structure):
    """LwRandom of orders.cpp."""

    _fields_: ClassVar = [
        *pointers("bits", "floats", "exponentials", "multinomial"),
    ]


class _RunsStruct(ctypes.Structure):
    """LwRuns of orders.cpp."""

    _fields_: ClassVar = [
        *pointers("start", "plain_in", "plain_before"),
        ("runs", ctypes.c_int64),
    ]


def random_orders(
    start: Ints, plain_in: Ints, plain_before: Ints, n: int, random: np.random.Generator
) -> tuple[Counts, Counts]:
    """n random orders of S special detections, and the plain false positives above each.

    start: (R + 1,) where each run of equal scores begins among them, and S; plain_in,
    plain_before: (R,) plain false positives in the run, and before it. Both returned are (n, S).
    The generator must not be used concurrently.
    """
    order, plain = np.empty((2, n, int(start[-1])), np.int32)
    bits: Any = random.bit_generator
    drawn = _RandomStruct(bits.ctypes.bit_generator.value, *_distributions())
    columns = [np.ascontiguousarray(c, np.int64) for c in (start, plain_in, plain_before)]
    runs = _RunsStruct(*(pointer(c) for c in columns), len(plain_in))
    call("lw_random_orders", drawn, runs, n, order, plain)
    return order, plain


@functools.cache
def _distributions() -> tuple[int | None, ...]:
    """Where numpy's functions are."""
    from numpy.random import _generator

    loaded = ctypes.CDLL(_generator.__file__)
    try:
        functions = [getattr(loaded, name) for name in _DISTRIBUTIONS]
    except AttributeError as error:
        raise InstallationError(
            "this numpy does not hand out its random distributions",
            found=f"numpy {np.__version__}: {error}",
            expected=", ".join(_DISTRIBUTIONS),
            next_step="install numpy from its own wheels",
        ) from error
    return tuple(ctypes.cast(function, ctypes.c_void_p).value for function in functions)


Steps = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True)
class _Ranking:
    """One category's detections that count at some threshold, in runs of equal score.

    special: (S,) positions of detections that are not a false positive at every threshold;
    group: (S,) their run of equal scores; plain_before, plain_in: (runs,) detections that are a
    false positive at every threshold, before the run and in it.
    """

    true: NDArray[np.bool_]  # (T, S)
    false: NDArray[np.bool_]  # (T, S)
    group: Ints
    plain_before: Ints
    plain_in: Ints

    @property
    def runs(self) -> tuple[Ints, Ints, Ints]:
        """Where each run that has special detections begins among them, and its plain ones."""
        start = np.flatnonzero(np.diff(self.group, prepend=-1))
        group = self.group[start]
        return np.append(start, len(self.group)), self.plain_in[group], self.plain_before[group]

    @property
    def has_ties(self) -> bool:
        """Whether any order is open: a run of several detections, not all alike."""
        sizes = np.bincount(self.group, minlength=len(self.plain_in))
        return bool(((sizes > 1) | ((sizes > 0) & (self.plain_in > 0))).any())


def tie_orders(table: MatchTable, *, draws: int, seed: int) -> Ties:
    """AP over all areas under `draws` random orders: mean, standard deviation and bounds."""

    def category_bounds(_k: int, ranking: _Ranking, n_truths: int) -> Floats:
        return _bounds(ranking, recall_steps(n_truths))

    worst, best = _mean_over_categories(table, category_bounds, 2)
    aps = order_aps(table, draws=draws, seed=seed)
    by_category = zip(table.category_slices, table.truths_per_category[0], strict=True)
    known = not np.isnan(aps).any()
    return Ties(
        expected=float(aps.mean()) if known else None,
        sd=(float(aps.std(ddof=1)) if draws > 1 else 0.0) if known else None,
        worst=number(worst),
        best=number(best),
        draws=draws,
        seed=seed,
        n_tied=sum(_count_tied(table.score[rows]) for rows, n_truths in by_category if n_truths),
    )


def order_aps(table: MatchTable, *, draws: int, seed: int) -> Floats:
    """(draws,) AP over all areas, one of each random order; NaN when no category has truth."""

    def sampled(k: int, ranking: _Ranking, n_truths: int) -> Floats:
        random = np.random.default_rng([seed, int(table.category_ids[k])])
        return _sample_ap(ranking, n_truths, draws, random)

    return _mean_over_categories(table, sampled, draws)


def _mean_over_categories(
    table: MatchTable, of_category: Callable[[int, _Ranking, int], Floats], n_values: int
) -> Floats:
    """(n_values,) mean over the categories with truth, NaN when there is none.

    of_category: the values of one, from its place, its ranking over all areas, its truths.
    """
    n_truths, slices = table.truths_per_category[0], table.category_slices
    scored = np.flatnonzero(n_truths).tolist()

    def category_values(k: int) -> Floats:
        rows = slices[k]
        ranking = _ranking(table.state[0, :, rows], table.score[rows])
        return of_category(k, ranking, int(n_truths[k]))

    total = np.zeros(n_values)
    with core_threads() as pool:
        # Added in category order: order-independent, bit-identical.
        for values in pool.map(category_values, scored):
            total += values
    return total / len(scored) if scored else np.full(n_values, np.nan)


def _count_tied(sorted_scores: Floats) -> int:
    """How many stand in runs of several equal ones."""
    edges = np.flatnonzero(np.diff(sorted_scores, prepend=np.nan, append=np.nan) != 0)
    sizes = np.diff(edges)
    return int(sizes[sizes > 1].sum())


def _ranking(state: NDArray[np.uint8], score: Floats) -> _Ranking:
    """state: (T, D) of one category, by falling score."""
    counted = (state != IGNORED).any(axis=0)
    state, score = state[:, counted], score[counted]
    special = (state != FALSE_POSITIVE).any(axis=0)
    group = np.cumsum(np.diff(score, prepend=score[:1]) != 0)
    n_groups = int(group[-1]) + 1 if len(group) else 0
    plain_in = np.bincount(group[~special], minlength=n_groups).astype(np.int64)
    return _Ranking(
        true=state[:, special] == TRUE_POSITIVE,
        false=state[:, special] == FALSE_POSITIVE,
        group=group[special],
        plain_before=np.cumsum(plain_in) - plain_in,
        plain_in=plain_in,
    )


def _sample_ap(ranking: _Ranking, n_truths: int, draws: int, random: np.random.Generator) -> Floats:
    """(draws,) AP of one category under random orders, averaged over thresholds."""
    n_special = len(ranking.group)
    if not n_special:
        return np.zeros(draws)
    is_true, is_ignored = pack_bits(ranking.true), pack_bits(~(ranking.true | ranking.false))
    if not ranking.has_ties:
        order = np.arange(n_special, dtype=np.int32)[None]
        alone = ranking.plain_before[ranking.group][None].astype(np.int32)
        return np.repeat(ordered_precision(is_true, is_ignored, order, alone, n_truths), draws)
    block = max(1, _BLOCK_ELEMENTS // n_special)
    values = np.empty(draws)
    for start in range(0, draws, block):
        n = min(block, draws - start)
        order, plain = random_orders(*ranking.runs, n, random)
        values[start : start + n] = ordered_precision(is_true, is_ignored, order, plain, n_truths)
    return values


def _bounds(ranking: _Ranking, steps: Steps) -> Floats:
    """(worst, best) AP of one category: false positives first in every run, or last."""
    values = np.zeros(2)
    if not len(ranking.group):
        return values
    n_groups = len(ranking.plain_in)
    for true, false in zip(ranking.true, ranking.false, strict=True):
        false_in = ranking.plain_in + np.bincount(ranking.group[false], minlength=n_groups)
        until = np.cumsum(false_in)
        group = ranking.group[true]
        above = np.stack([until[group], (until - false_in)[group]])
        n_true = np.arange(1, len(group) + 1)
        values += mean_precision(n_true, n_true + above, steps[: len(group)])
    result: Floats = values / len(ranking.true)
    return result
