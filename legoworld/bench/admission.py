"""Settings of `bench serve --http`: how much is taken at once, and what is counted of it.

Without the packages that the server needs.
"""

from __future__ import annotations

import itertools
import math
import os
import secrets
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Final

from legoworld import extras
from legoworld.errors import UsageError, cause
from legoworld.workers.removal import remove_folder

TOKEN_VARIABLE: Final = "LEGOWORLD_SERVE_TOKEN"
_SHORTEST_TOKEN: Final = 16


@dataclass(frozen=True, kw_only=True)
class HttpOptions:
    """Where it listens, who may ask, and how much is taken.

    queue: orders that are received, wait or are scored at once; step: of every score, 0 for exact
    ones; per_object: answer with each object's row, too. receive_s: for one whole request.
    """

    host: str = "127.0.0.1"
    port: int = 8000
    token: str
    queue: int = 256
    body_bytes: int = 128 << 20
    unpacked_bytes: int = 512 << 20
    step: float = 0.01
    per_object: bool = False
    receive_s: float = 30.0

    @property
    def spool_bytes(self) -> int:
        """What may lie on disk of requests that are not answered yet."""
        return 16 * self.body_bytes


def access_token(file: Path | None) -> tuple[str, bool]:
    """The bearer token of a file, else of the environment, else a new one; whether it is new.

    UsageError for one that is too short.
    """
    try:
        token = file.read_text("utf-8").strip() if file else os.environ.get(TOKEN_VARIABLE, "")
    except (OSError, ValueError) as error:
        raise UsageError(f"the token file {file} cannot be read", found=cause(error)) from error
    if not token and file is None:
        return secrets.token_urlsafe(32), True
    if len(token) < _SHORTEST_TOKEN or not token.isascii() or not token.isprintable():
        raise UsageError(
            "the bearer token cannot be used",
            found=f"{len(token)} characters",
            expected=f"at least {_SHORTEST_TOKEN} printable ASCII characters",
            next_step="python -c 'import secrets; print(secrets.token_urlsafe(32))' makes one",
        )
    return token, False


def require_http(what: str) -> None:
    """InstallationError without the extra that an HTTP server needs. what: such as "view"."""
    extras.require_extra("serve", f"`{what}`", ("starlette", "uvicorn"))


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
