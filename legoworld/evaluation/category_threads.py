"""Threads for work that falls into categories: numpy lets go of the interpreter while it counts."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Final

from legoworld.workers.processors import usable_cores

_MOST_THREADS: Final = 8


def category_threads() -> ThreadPoolExecutor:
    """A pool of a thread for each core. Its results are added in the categories' order."""
    return ThreadPoolExecutor(min(_MOST_THREADS, usable_cores()))
