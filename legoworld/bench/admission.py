"""How much of `bench serve --http` is taken at once, and what is counted of it."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Final

from legoworld.workers.removal import remove_folder

#: Upper ends of the histogram of seconds from a request's first byte to its answer.
_SECONDS: Final = (0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0, math.inf)


class Admission:
    """Places for orders, and bytes on disk for what is sent with them, below `scratch`."""

    def __init__(self, scratch: Path, places: int, spool_bytes: int) -> None:
        self._scratch, self._most, self._most_bytes = scratch, places, spool_bytes
        self._changing = Lock()
        self._numbers = itertools.count()
        self.places = self.spool_bytes = 0

    def take(self, places: int = 1, spool_bytes: int = 0) -> Place | None:
        """Places that are held until they are released; None where there is no room now."""
        with self._changing:
            if self.places + places > self._most:
                return None
            if self.spool_bytes + spool_bytes > self._most_bytes:
                return None
            self.places += places
            self.spool_bytes += spool_bytes
        folder = self._scratch / f"request-{next(self._numbers)}" if spool_bytes else None
        return Place(self, places, spool_bytes, folder)

    def _give_back(self, place: Place) -> None:
        with self._changing:
            self.places -= place.places
            self.spool_bytes -= place.spool_bytes
            place.places = place.spool_bytes = 0


@dataclass
class Place:
    """Room for one request. folder: for what is sent, removed with the place; None: for nothing."""

    admission: Admission
    places: int
    spool_bytes: int
    folder: Path | None

    def release(self) -> None:
        """Give it back; further calls do nothing."""
        if self.folder is not None:
            remove_folder(self.folder)
        self.admission._give_back(self)


@dataclass
class Counts:
    """What has been answered so far, for /metrics. seconds: of answers, not of refusals."""

    answers: Counter[str] = field(default_factory=Counter)
    refusals: Counter[int] = field(default_factory=Counter)
    within: Counter[float] = field(default_factory=Counter)
    seconds: float = 0.0

    def answer(self, status: str, seconds: float) -> None:
        """One more answer of a status."""
        self.answers[status] += 1
        self.seconds += seconds
        self.within.update(end for end in _SECONDS if seconds <= end)

    @property
    def mean_s(self) -> float:
        """Of an answer; 1 before the first."""
        return self.seconds / n if (n := self.answers.total()) else 1.0

    def text(self, gauges: Iterable[tuple[str, float]]) -> str:
        """Prometheus' text format. gauges: names without their prefix, and values."""
        lines = ["# TYPE legoworld_answers_total counter"]
        lines += [f'legoworld_answers_total{{status="{s}"}} {n}' for s, n in self.answers.items()]
        lines += ["# TYPE legoworld_refusals_total counter"]
        lines += [f'legoworld_refusals_total{{code="{c}"}} {n}' for c, n in self.refusals.items()]
        lines += ["# TYPE legoworld_answer_seconds histogram"]
        lines += [
            f'legoworld_answer_seconds_bucket{{le="{"+Inf" if end == math.inf else end}"}} '
            f"{self.within[end]}"
            for end in _SECONDS
        ]
        lines += [f"legoworld_answer_seconds_sum {self.seconds}"]
        lines += [f"legoworld_answer_seconds_count {self.answers.total()}"]
        for name, value in gauges:
            kind = "counter" if name.endswith("_total") else "gauge"
            lines += [f"# TYPE legoworld_{name} {kind}", f"legoworld_{name} {value}"]
        return "\n".join([*lines, ""])
