"""Ending what a trial has started, from another thread: Ctrl-C does not wait for agents."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from legoworld.errors import LegoWorldError


class TrialStoppedError(LegoWorldError):
    """The run was stopped while a trial was under way."""

    code = "stopped"


class Stop:
    """Stops the current trial; after `now` no other trial starts."""

    def __init__(self) -> None:
        self._owning = threading.Lock()
        self._over = False
        self._ends: list[Callable[[], None]] = []

    def now(self) -> None:
        """Stop everything that is running."""
        with self._owning:
            self._over = True
            ends = list(self._ends)
        for end in ends:
            end()

    def check(self) -> None:
        """Raise TrialStoppedError where the run was stopped."""
        if self._over:
            raise TrialStoppedError("the run was stopped", found="a trial under way")

    @contextmanager
    def ends(self, end: Callable[[], None]) -> Iterator[None]:
        """Call `end` when the run is stopped during the block."""
        with self._owning:
            self._ends.append(end)
            over = self._over
        try:
            if over:
                end()
            yield
        finally:
            with self._owning:
                self._ends.remove(end)
