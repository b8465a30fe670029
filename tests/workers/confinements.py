"""The two ways a program is confined, for tests that must hold under both."""

from __future__ import annotations

import pytest

from legoworld.workers.bubblewrap import Bubblewrap, find_bubblewrap


def bubblewrap_or_skip() -> None:
    """Skip with the reason where this machine has no bubblewrap that works."""
    found = find_bubblewrap()
    if not isinstance(found, Bubblewrap):
        pytest.skip(found)


CONFINEMENTS = ["bubblewrap", "limits"]
