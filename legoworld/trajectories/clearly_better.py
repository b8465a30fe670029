"""Whether one scene keeps the same requirements clearly better than another: a paired test.

Requirements order scenes that are far apart, and hardly those that differ by a point of R. An
agent's last scene is often its best, so it is left only for one that keeps more requirements than
chance would have flip (McNemar 1947).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from legoworld.records.plugin_requirements import Report, Result

#: So many standard deviations of a fair coin: 4 kept to 0 lost, 7 to 1, 14 to 5 at least.
CLEARLY: Final = 2.0


def clearly_best(reports: Sequence[Report]) -> int:
    """The position of the last scene, or of the one that leads it most, if clearly.

    reports: of the same requirements in the same order, the scenes in theirs. Of equals the later.
    """
    last = len(reports) - 1
    leads = [lead(report.results, reports[last].results) for report in reports[:last]]
    best = max(range(last), key=lambda i: (leads[i], i), default=last)
    return best if last and leads[best] >= CLEARLY else last


def lead(first: Sequence[Result], second: Sequence[Result]) -> float:
    """(k - l) / sqrt(k + l) over the requirements that pass in one of two scenes alone.

    k pass in the first, l in the second; 0 where there are none. Unknown does not pass, so that a
    scene does not gain by what it hides.
    """
    kept = lost = 0
    for one, other in zip(first, second, strict=True):
        kept += one.verdict == "pass" and other.verdict != "pass"
        lost += other.verdict == "pass" and one.verdict != "pass"
    return (kept - lost) / math.sqrt(kept + lost) if kept + lost else 0.0
