"""Progress of a run: images done, failed, rate and remaining time."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from legoworld.api.listening import Listener
from legoworld.commands import options
from legoworld.pluralize import share
from legoworld.records.run_rows import RunRow

#: Seconds between two lines of progress in a log.
_LINE_S: Final = 30.0


class LineProgress:
    """Progress lines for a log: at the first image, then at most once per `_LINE_S`."""

    def __init__(self, say: Callable[[str], None], clock: Callable[[], float]) -> None:
        self._say, self._clock = say, clock
        self._total = self._done = self._failed = self._kept = 0
        self._start = clock()
        self._next = self._start

    def total(self, n: int) -> None:
        """Set the number of images."""
        self._total = n

    def kept(self, n: int) -> None:
        """Count the images kept from an earlier run; they do not affect the rate."""
        self._kept = n

    def __call__(self, row: RunRow) -> None:
        """Count one image that was predicted in this run."""
        self._done += 1
        self._failed += row.status != "ok"
        now = self._clock()
        if now < self._next and self._kept + self._done < self._total:
            return
        self._next = now + _LINE_S
        failed = f", {self._failed} failed" if self._failed else ""
        pace = f", {(now - self._start) / self._done:.2g} s an image"
        done = share(self._kept + self._done, self._total, "image", "images")
        self._say(f"{done}{failed}{pace}")


@contextmanager
def shown_progress(unit: str, *, quiet: bool, lines: bool = False) -> Iterator[Listener]:
    """A progress bar on standard error if that is a terminal; it starts at the kept images.

    lines: whether to print a line now and then if it is not a terminal.
    """
    say = options.notifier(quiet)
    if lines and not quiet and not options.on_terminal():
        counter = LineProgress(say, time.monotonic)
        yield Listener(total=counter.total, row=counter, kept=counter.kept, notice=say, warn=say)
        return
    if quiet or not options.on_terminal():
        yield Listener(notice=say, warn=say)
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

        yield Listener(total=total, row=row, kept=kept, notice=write, warn=write)
