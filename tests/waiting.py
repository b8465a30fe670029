"""Waiting for what must happen, however slow the machine is: for an event, with a generous end."""

from __future__ import annotations

import time
from collections.abc import Callable

#: No test is about speed: only what never happens takes this long.
PATIENCE_S = 300.0


def until(happened: Callable[[], object], what: str = "what was waited for") -> None:
    """Return once `happened` is true; AssertionError after PATIENCE_S."""
    deadline = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline, f"{what} did not happen within {PATIENCE_S:g} s"
        time.sleep(0.01)
