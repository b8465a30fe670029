"""Progress of a run: images done, failed, rate and remaining time."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from legoworld.api.listener import Listener
from legoworld.commands.output import Output, on_terminal
from legoworld.pluralize import share
from legoworld.records.run_rows import RunRow

#: Seconds before the first line of progress in a log, and between two lines.
_FIRST_S: Final = 2.0
_LINE_S: Final = 30.0


class LineProgress:
    """Progress lines for a log: none in the first seconds, then one every `_LINE_S`, and the last.

    unit: what a row is of, for example "scene".
    """

    def __init__(self, unit: str, say: Callable[[str], None], clock: Callable[[], float]) -> None:
        self._unit, self._say, self._clock = unit, say, clock
        self._total = self._done = self._failed = self._kept = 0
        self._start = clock()
        self._next = self._start + _FIRST_S

    def total(self, n: int) -> None:
        """Set the number of units."""
        self._total = n

    def count_kept(self, n: int) -> None:
        """Count the units kept from an earlier run; they do not affect the rate."""
        self._kept = n

    def __call__(self, row: RunRow) -> None:
        """Count one unit that was done in this run."""
        self._done += 1
        self._failed += row.status != "ok"
        now = self._clock()
        ends = self._kept + self._done == self._total and now >= self._start + _FIRST_S
        if now < self._next and not ends:
            return
        self._next = now + _LINE_S
        failed = f", {self._failed} failed" if self._failed else ""
        pace = f", {(now - self._start) / self._done:.2g} s each"
        done = share(self._kept + self._done, self._total, self._unit, f"{self._unit}s")
        self._say(f"{done}{failed}{pace}")


@contextmanager
def shown_progress(unit: str, *, quiet: bool) -> Iterator[Listener]:
    """A progress bar on standard error that starts at the kept units; lines without a terminal."""
    out = Output(quiet=quiet)
    say = out.notice
    if not quiet and not on_terminal():
        counter = LineProgress(unit, say, time.monotonic)
        yield Listener(
            total=counter.total, row=counter, kept=counter.count_kept, notice=say, warn=out.warn
        )
        return
    if quiet:
        yield Listener(notice=say, warn=out.warn)
        return
    from tqdm import tqdm

    with tqdm(total=None, unit=unit, leave=False) as bar:
        failed = 0

        def total(n: int) -> None:
            bar.total = n
            bar.refresh()

        def row(done: RunRow) -> None:
            nonlocal failed
            failed += done.status != "ok"
            bar.set_postfix(failed=failed, refresh=False)
            bar.update()

        def kept(n: int) -> None:
            """Count kept images; rate and remaining time only consider this run's own work."""
            bar.initial = bar.n = n
            bar.start_t = bar.last_print_t = time.time()
            bar.refresh()

        def write(text: str) -> None:
            bar.write(text, file=sys.stderr)

        def warn(text: str) -> None:
            write(f"warning: {text}")

        yield Listener(total=total, row=row, kept=kept, notice=write, warn=warn)
