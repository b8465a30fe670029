"""Removing a folder that an untrusted program has filled."""

from __future__ import annotations

import contextlib
import os
import stat
from itertools import count
from pathlib import Path

_NOT_FOLLOWED = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC


def remove_folder(folder: Path) -> None:
    """Remove a folder with everything below it, as far as the system allows.

    Links out of the folder are not followed. Missing permissions are added, and folders nested too
    deeply for paths or recursion are moved to the top, level by level.
    """
    with contextlib.suppress(OSError):
        top = os.open(folder, _NOT_FOLLOWED)
        try:
            _empty(top)
        finally:
            os.close(top)
    with contextlib.suppress(OSError):
        folder.rmdir()


def _empty(top: int) -> None:
    numbers = count()
    pending = _remove_files(top)
    while pending:
        name = pending.pop()
        with contextlib.suppress(OSError):
            os.chmod(name, stat.S_IRWXU, dir_fd=top)
        try:
            below = os.open(name, _NOT_FOLLOWED, dir_fd=top)
        except OSError:
            continue
        try:
            for inner in _remove_files(below):
                moved = f".removing-{next(numbers)}"
                with contextlib.suppress(OSError):
                    # A folder that may not be written cannot be moved: its ".." would change.
                    os.chmod(inner, stat.S_IRWXU, dir_fd=below)
                with contextlib.suppress(OSError):
                    os.rename(inner, moved, src_dir_fd=below, dst_dir_fd=top)
                    pending.append(moved)
        finally:
            os.close(below)
        with contextlib.suppress(OSError):
            os.rmdir(name, dir_fd=top)


def _remove_files(folder: int) -> list[str]:
    """Remove everything but folders; return the names of the folders."""
    with os.scandir(folder) as entries:
        listed = [(entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries]
    for name, is_folder in listed:
        if not is_folder:
            with contextlib.suppress(OSError):
                os.unlink(name, dir_fd=folder)
    return [name for name, is_folder in listed if is_folder]
