"""A summary of rows: ratios of sums, with intervals over images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.bootstrap import interval, resample_counts, weighted_sums
from legoworld.records.base import number
from legoworld.records.relations import Metric, RelationsRow, Sums

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
POLICIES: Final = ("answers", "chance", "blind")
_NOTHING: Final = Sums(n=0, score=0.0, chance=0.0, blind=0.0)


def sums_of(name: str, rows: Sequence[RelationsRow]) -> list[Sums]:
    """A metric's sums of each row; of a relation, those of its accuracy."""
    known = "accuracy" if name == "chance_adjusted" else name
    return [row.sums.get(known) or row.by_relation.get(known, _NOTHING) for row in rows]


def ratios(name: str, of_rows: Sequence[Sums], sum_up: Callable[[Floats], Floats]) -> Floats:
    """(3, ...) a metric of the answers, a guess and the prior; NaN where nothing is asked.

    sum_up: sums over rows, (rows,), or over resampled rows.
    """
    columns = np.array([(s.n, s.score, s.chance, s.blind) for s in of_rows], np.float64)
    n, *sums = (sum_up(column) for column in columns.reshape(-1, 4).T)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = np.stack(sums) / n
        if name == "chance_adjusted":  # how much of what a guess leaves is gained
            shares = (shares - shares[1]) / (1 - shares[1])
    return np.asarray(shares)


def values(name: str, of_rows: Sequence[Sums]) -> Floats:
    """(3,) a metric over all rows."""
    return ratios(name, of_rows, lambda column: column.sum(keepdims=True))[:, 0]


def metrics(
    names: Sequence[str], rows: Sequence[RelationsRow], draws: int, seed: int
) -> dict[str, Metric]:
    """The metrics, or relations, of which something was asked."""
    counts = resample_counts(len(rows), draws, seed) if len(rows) > 1 else None
    found = {}
    for name in names:
        of_rows = sums_of(name, rows)
        answers, chance, blind = map(number, values(name, of_rows).tolist())
        guessed, n = METRICS.get(name, True), sum(s.n for s in of_rows)
        if not n:
            continue
        around = None
        if counts is not None:
            drawn = ratios(name, of_rows, lambda column: weighted_sums(counts, column))[0]
            around = interval(drawn, unit="image")
        found[name] = Metric(
            n=n,
            answers=answers,
            chance=chance if guessed else None,
            blind=blind if guessed else None,
            interval=around,
        )
    return found
