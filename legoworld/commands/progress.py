"""The progress of a run on a terminal: images done, failed, rate and remaining time."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

from legoworld.commands import options

#: Seconds between two lines of progress in a log.
_LINE_S: Final = 30.0


def _nothing(_told: Any) -> None:
    """Without a terminal nothing is shown."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """What a run tells while it works.

    row: of an image that was done now; kept: how many images an earlier run had done; say: a line.
    """

    row: Callable[[dict[str, Any]], None]
    kept: Callable[[int], None]
    say: Callable[[str], None]


class LineProgress:
    """Says how far a run is, for a log: at the first image, then at most once in `_LINE_S`."""

    def __init__(self, total: int, say: Callable[[str], None], clock: Callable[[], float]) -> None:
        self._total, self._say, self._clock = total, say, clock
        self._done = self._failed = self._kept = 0
        self._start = clock()
        self._next = self._start

    def kept(self, n: int) -> None:
        """Count what an earlier run has predicted; the pace is of this one's."""
        self._kept = n

    def __call__(self, row: dict[str, Any]) -> None:
        """Count one image that was predicted now."""
        self._done += 1
        self._failed += row["status"] != "ok"
        now = self._clock()
        if now < self._next and self._kept + self._done < self._total:
            return
        self._next = now + _LINE_S
        failed = f", {self._failed} failed" if self._failed else ""
        pace = f", {(now - self._start) / self._done:.2g} s an image"
        self._say(f"{self._kept + self._done} of {self._total} images{failed}{pace}")


@contextmanager
def shown_progress(
    total: int, unit: str, *, quiet: bool, lines: bool = False
) -> Iterator[Progress]:
    """A bar on standard error where that is a terminal; it begins at what is done already.

    lines: whether there is a line now and then where it is none.
    """
    if lines and not quiet and not options.on_terminal():
        say = options.notifier(quiet)
        counter = LineProgress(total, say, time.monotonic)
        yield Progress(row=counter, kept=counter.kept, say=say)
        return
    if quiet or not options.on_terminal():
        yield Progress(row=_nothing, kept=_nothing, say=options.notifier(quiet))
        return
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, leave=False) as bar:
        failed = 0

        def row(done: dict[str, Any]) -> None:
            nonlocal failed
            failed += done["status"] != "ok"
            bar.set_postfix(failed=failed, refresh=False)
            bar.update()

        def kept(n: int) -> None:
            """The rate and the remaining time are of what this run does itself."""
            bar.initial = bar.n = n
            bar.start_t = bar.last_print_t = time.time()
            bar.refresh()

        yield Progress(row=row, kept=kept, say=lambda text: bar.write(text, file=sys.stderr))
