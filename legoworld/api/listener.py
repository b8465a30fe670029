"""Callbacks of long-running calls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from legoworld.records.agents import TrialRow
from legoworld.records.depth import DepthRow
from legoworld.records.reconstruction import ReconstructionRow
from legoworld.records.run_rows import RunRow


def _ignore_event(_told: object) -> None:
    """Ignore the event."""


@dataclass(frozen=True, kw_only=True)
class Listener:
    """Callbacks for progress; each is optional.

    total: the number of images, before the first; kept: the number of images kept from an earlier
    run; row: the row of a finished image; scored: an evaluated depth image or bench case; trial: a
    trial of `reconstruct` that ended; notice: the current step; warn: a caveat for readers of the
    results; trace: the traceback of an unexpected error; log: a line that a baseline printed.
    """

    total: Callable[[int], None] = _ignore_event
    kept: Callable[[int], None] = _ignore_event
    row: Callable[[RunRow], None] = _ignore_event
    scored: Callable[[DepthRow | ReconstructionRow], None] = _ignore_event
    trial: Callable[[TrialRow], None] = _ignore_event
    notice: Callable[[str], None] = _ignore_event
    warn: Callable[[str], None] = _ignore_event
    trace: Callable[[str], None] = _ignore_event
    log: Callable[[str], None] = _ignore_event


#: A listener that ignores everything.
SILENT = Listener()
