"""A summary of rows: ratios of sums, with intervals over images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.bootstrap import interval, resample_counts, weighted_sums
from legoworld.records.base import number
from legoworld.records.evaluation_summary import Coverage, Interval
from legoworld.records.relations import Metric, RelationMetric, RelationsRow, Sums

Floats = NDArray[np.float64]

#: Metrics in display order, and whether a guess and the prior have a value of it.
METRICS: Final = {
    "accuracy": True,
    "chance_adjusted": True,
    "accuracy_answered": True,
    "answered": False,
    "count_exact": True,
    "count_error": False,
    "mra": True,
    "refer_50": True,
}
_OF_SUMS: Final = {"chance_adjusted": "accuracy"}


def ratios(name: str, rows: Sequence[RelationsRow], sum_up: Callable[[Floats], Floats]) -> Floats:
    """(3, ...) a metric of the answers, a guess and the prior; NaN where nothing is asked.

    sum_up: sums over rows, (rows,), or over resampled rows.
    """
    empty = Sums(n=0, score=0.0, chance=0.0, blind=0.0)
    of_rows = [row.sums.get(_OF_SUMS.get(name, name), empty) for row in rows]
    columns = np.array([(s.n, s.score, s.chance, s.blind) for s in of_rows], np.float64)
    n, *sums = (sum_up(column) for column in columns.reshape(-1, 4).T)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = np.stack(sums) / n
        if name in _OF_SUMS:  # how much of what a guess leaves is gained
            shares = (shares - shares[1]) / (1 - shares[1])
    return np.asarray(shares)


def metrics(rows: Sequence[RelationsRow], draws: int, seed: int) -> dict[str, Metric]:
    """Every metric that something was asked of, in display order."""
    counts = resample_counts(len(rows), draws, seed) if len(rows) > 1 else None
    found = {}
    for name, guessed in METRICS.items():
        values = ratios(name, rows, lambda column: column.sum(keepdims=True))[:, 0]
        n = sum(row.sums[key].n for row in rows if (key := _OF_SUMS.get(name, name)) in row.sums)
        if n:
            found[name] = Metric(
                n=n,
                answers=number(values[0]),
                chance=number(values[1]) if guessed else None,
                blind=number(values[2]) if guessed else None,
                interval=_interval(name, rows, counts),
            )
    return found


def _interval(
    name: str, rows: Sequence[RelationsRow], counts: NDArray[np.int32] | None
) -> Interval | None:
    if counts is None:
        return None
    samples = ratios(name, rows, lambda column: weighted_sums(counts, column))[0]
    return interval(samples, unit="image")


def by_relation(rows: Sequence[RelationsRow]) -> tuple[RelationMetric, ...]:
    """The accuracy of each relation that is asked, by name."""
    names = sorted({name for row in rows for name in row.by_relation})
    found = []
    for name in names:
        of_rows = [row.by_relation[name] for row in rows if name in row.by_relation]
        n = sum(s.n for s in of_rows)
        found.append(
            RelationMetric(
                relation=name,
                n=n,
                answers=sum(s.score for s in of_rows) / n,
                chance=sum(s.chance for s in of_rows) / n,
                blind=sum(s.blind for s in of_rows) / n,
                interval=None,
            )
        )
    return tuple(found)


def coverage(rows: Sequence[RelationsRow]) -> Coverage:
    """Images by outcome."""
    return Coverage(
        attempted=len(rows),
        scored=sum(row.has_score for row in rows),
        with_truth=sum(row.has_truth for row in rows),
        by_status=dict(sorted(Counter(row.status for row in rows).items())),
    )


def unanswered(rows: Sequence[RelationsRow]) -> dict[str, int]:
    """Questions without an answer, by the reason."""
    total: Counter[str] = Counter()
    for row in rows:
        total.update(row.why)
    return dict(sorted(total.items()))
