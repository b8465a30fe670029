"""Whether this machine has the stronger of the two ways a program is confined."""

from __future__ import annotations

import pytest

from legoworld.workers.bubblewrap import Bubblewrap, find_bubblewrap


def bubblewrap_or_skip() -> None:
    """Skip with the reason where this machine has no bubblewrap that works."""
    found = find_bubblewrap()
    if not isinstance(found, Bubblewrap):
        pytest.skip(found)
