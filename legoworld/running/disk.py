"""Check that the depth files will fit on the disk before the first one is written."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from legoworld import exit_codes
from legoworld.errors import LegoWorldError
from legoworld.pluralize import counted
from legoworld.readouts.depth import depth_file_bytes


class OutputFullError(LegoWorldError):
    """The run's output does not fit on the disk."""

    code = "disk_full"
    exit_code = exit_codes.BLOCKED


def check_disk(
    folder: Path,
    sizes_wh: Sequence[tuple[int, int]],
    notice: Callable[[str], None],
    *,
    next_step: str,
) -> None:
    """Report the size of float32 depth at these sizes; OutputFullError if it does not fit."""
    expected = sum(depth_file_bytes(size) for size in sizes_wh)
    free = shutil.disk_usage(folder).free
    notice(
        f"depth: about {_megabytes(expected)} for "
        f"{counted(len(sizes_wh), 'image', 'images')} of known size, "
        f"{_megabytes(free)} free"
    )
    if expected > free:
        raise OutputFullError(
            "the depth files will not fit on the disk",
            found=f"{_megabytes(free)} free",
            expected=_megabytes(expected),
            next_step=next_step,
        )


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB"
