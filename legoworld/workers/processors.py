"""The number of CPU cores this process may use."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Final

#: Linux's limit of a container or a service: "<quota> <period>", or "max <period>".
_QUOTA: Final = Path("/sys/fs/cgroup/cpu.max")


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
