"""Threads for per-category work: NumPy releases the GIL."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Final

from legoworld.workers.processors import usable_cores

_MOST_THREADS: Final = 8


def category_threads() -> ThreadPoolExecutor:
    """A pool with one thread per core. Its results are added in category order."""
    return ThreadPoolExecutor(min(_MOST_THREADS, usable_cores()))
