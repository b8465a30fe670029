"""Whether one scene keeps the same requirements clearly better than another: a paired sign test.

Residuals order scenes that are far apart, and hardly those that differ by a point of R. An agent's
last scene is often its best, so it is left only for a scene that the requirements, one by one and
beyond their noise, agree on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from legoworld.records.plugin_requirements import Report, Result

#: A residual counts in tolerances, at most this many; what cannot be measured counts as many, so
#: that it is never better, and that deleting or hiding an object does not pay.
MOST: Final = 10.0
#: Stands for a tolerance of 0: the order of depth then counts in tenths of the pairs.
_OF_NONE: Final = 0.1
#: A difference of two residuals below this share of their tolerance is noise.
NOISE: Final = 0.5
#: So many standard deviations of a fair coin: 4 to 0, 8 to 1, 15 to 5.
CLEARLY: Final = 2.0


def clearly_best(reports: Sequence[Report]) -> int:
    """The position of the last scene, or of the one that is clearly better by the most.

    reports: of the same requirements in the same order, the scenes in theirs. Of equals the later.
    """
    last = len(reports) - 1
    leads = [lead(report.results, reports[last].results) for report in reports[:last]]
    best = max(range(last), key=lambda i: (leads[i], i), default=last)
    return best if last and leads[best] >= CLEARLY else last


def lead(first: Sequence[Result], second: Sequence[Result]) -> float:
    """(wins - losses) / sqrt(wins + losses) of the first over the second, by requirements.

    0 where none differs by more than noise.
    """
    wins = losses = 0
    for one, other in zip(first, second, strict=True):
        difference = tolerances(other) - tolerances(one)
        wins += difference > NOISE
        losses += difference < -NOISE
    return (wins - losses) / math.sqrt(wins + losses) if wins + losses else 0.0


def tolerances(result: Result) -> float:
    """A residual in tolerances, at most `MOST`."""
    if result.residual is None:
        return MOST
    return min(result.residual / (result.tolerance or _OF_NONE), MOST)
