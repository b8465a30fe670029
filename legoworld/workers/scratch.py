"""Folders for work in progress. If the owner is killed, the next owner deletes its folder.

An owner holds a lock on a file in its folder while it lives, so a folder with a free lock has no
owner. The file's name includes the machine's: locks need not work across a shared disk.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from legoworld.workers.removal import remove_folder


class ScratchFolder:
    """An empty folder `<prefix>...` in `parent` (None: the system's temporary folder).

    owner_fd: a process that inherits it also keeps the folder from being deleted.
    """

    def __init__(self, prefix: str, parent: Path | None = None) -> None:
        parent = parent or Path(tempfile.gettempdir())
        _sweep(prefix, parent)
        self.path = Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
        try:
            self.owner_fd = _lock_folder(self.path)
        except BaseException:
            remove_folder(self.path)
            raise

    def close(self) -> None:
        """Remove the folder with everything in it; further calls do nothing."""
        if self.owner_fd < 0:
            return
        try:
            remove_folder(self.path)
        finally:
            os.close(self.owner_fd)
            self.owner_fd = -1


@contextmanager
def scratch_folder(prefix: str, parent: Path | None = None) -> Iterator[Path]:
    """A scratch folder for the duration of the block."""
    folder = ScratchFolder(prefix, parent)
    try:
        yield folder.path
    finally:
        folder.close()


def _owner_file() -> str:
    return f".owner-{os.uname().nodename}"


def _lock_folder(folder: Path) -> int:
    """The descriptor of the held lock. The file is named once locked, so no sweep is too early."""
    unheld = folder / ".owner"
    descriptor = os.open(unheld, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
    # On a file system without locks the file keeps its first name, and the folder is never swept.
    with suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        unheld.rename(folder / _owner_file())
    return descriptor


def _sweep(prefix: str, parent: Path) -> None:
    """Remove this machine's folders with this prefix that have no owner."""
    for folder in parent.glob(f"{prefix}*"):
        try:
            descriptor = os.open(folder / _owner_file(), os.O_RDWR | os.O_CLOEXEC)
        except OSError:
            continue  # another machine's, another user's, or only just made
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            continue  # it has its owner
        else:
            remove_folder(folder)
        finally:
            os.close(descriptor)
