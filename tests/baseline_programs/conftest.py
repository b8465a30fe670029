"""What every test of a baseline runs under."""

from __future__ import annotations

import sys

import pytest


@pytest.fixture(autouse=True)
def _quiet_transformers() -> None:
    """No progress bars and no advice, where a test's module has loaded transformers."""
    if transformers := sys.modules.get("transformers"):
        transformers.logging.disable_progress_bar()
        transformers.logging.set_verbosity_error()
