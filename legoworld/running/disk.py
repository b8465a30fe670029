"""Check that the files of the images will fit on the disk before the first one is written."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from legoworld import exit_codes
from legoworld.errors import LegoWorldError
from legoworld.pluralize import plural


class OutputFullError(LegoWorldError):
    """The run's output does not fit on the disk."""

    code = "disk_full"
    exit_code = exit_codes.BLOCKED


def check_disk(
    folder: Path,
    file_bytes: Sequence[int],
    notice: Callable[[str], None],
    *,
    what: str,
    next_step: str,
    beside: int = 0,
) -> None:
    """Report the size of all files; OutputFullError if they do not fit.

    what: such as "depth"; beside: bytes that other runs of the same pass write.
    """
    expected = sum(file_bytes)
    free = shutil.disk_usage(folder).free
    notice(
        f"{what}: about {_megabytes(expected)} for "
        f"{plural(len(file_bytes), 'image', 'images')} of known size, "
        f"{_megabytes(free)} free"
    )
    if expected + beside > free:
        raise OutputFullError(
            f"the {what} files will not fit on the disk",
            found=f"{_megabytes(free)} free",
            expected=_megabytes(expected + beside),
            next_step=next_step,
        )


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.0f} MB"
