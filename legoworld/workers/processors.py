"""The number of CPU cores this process may use, and threads for them."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

#: Linux's limit of a container or a service: "<quota> <period>", or "max <period>".
_QUOTA: Final = Path("/sys/fs/cgroup/cpu.max")
_MOST_THREADS: Final = 8


def usable_cores(quota: Path = _QUOTA) -> int:
    """CPU cores this process may use, from its affinity and its cgroup quota, if any.

    A quota of one and a half cores counts as two.
    """
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    try:
        allowed, period = quota.read_text(encoding="ascii").split()
        return max(1, min(cores, math.ceil(int(allowed) / int(period))))
    except (OSError, ValueError, ZeroDivisionError):  # none, no limit ("max"), or another system
        return cores


def core_threads() -> ThreadPoolExecutor:
    """A pool with a thread for each core, for work that releases the GIL, as NumPy's does."""
    return ThreadPoolExecutor(min(_MOST_THREADS, usable_cores()))
