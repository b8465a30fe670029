"""What a long call tells while it works."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from legoworld.records.evaluation_rows import DepthRow


def _nothing(_told: object) -> None:
    """Nobody listens."""


@dataclass(frozen=True, kw_only=True)
class Listener:
    """Functions that are called as the work goes on; each may be left out.

    total: how many images there are, before the first; kept: how many an earlier run has done;
    row: the run's row of an image that is done; scored: an image of depth that is evaluated;
    notice: what is being done; warn: what the reader of the results must know; trace: the
    traceback of an error that no verdict foresees.
    """

    total: Callable[[int], None] = _nothing
    kept: Callable[[int], None] = _nothing
    row: Callable[[dict[str, Any]], None] = _nothing
    scored: Callable[[DepthRow], None] = _nothing
    notice: Callable[[str], None] = _nothing
    warn: Callable[[str], None] = _nothing
    trace: Callable[[str], None] = _nothing


#: Nobody listens.
SILENT = Listener()
