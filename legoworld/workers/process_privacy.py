"""What a process asks of the system for itself: privacy, and an end with its parent."""

from __future__ import annotations

import ctypes
import signal
import sys
from typing import Final

_PR_SET_PDEATHSIG: Final = 1
_PR_SET_DUMPABLE: Final = 4


def hide_process() -> None:
    """Protect /proc/PID/environ, mem, fd and tracing from other programs of the same user.

    A program without bubblewrap is one of those; what a process execs is not hidden. It is no
    protection against root or CAP_SYS_PTRACE, nor of the user's other processes, a shell with the
    same variables among them: `Protections` counts on bubblewrap alone. Linux only.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 0, 0, 0, 0)


def die_with_parent() -> None:
    """Be killed when the parent ends, even while busy; without it only reading input ends it."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
