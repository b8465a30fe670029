"""Locks between processes that write into one folder: one rule for every command.

A file system without `flock` (NFS without a lock daemon, some Lustre mounts) is refused, because
two processes would not notice each other. LEGOWORLD_UNLOCKED=1 says that there is one writer only.
"""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from legoworld import exit_codes
from legoworld.errors import LegoWorldError, cause

UNLOCKED: Final = "LEGOWORLD_UNLOCKED"
_NO_LOCKS: Final = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


class NoLocksError(LegoWorldError):
    """The file system of a folder has no locks."""

    code = "no_locks"
    exit_code = exit_codes.BLOCKED


def take(descriptor: int, place: Path, *, wait: bool) -> bool:
    """Lock an open file or folder; the lock ends with its descriptor, however the process ends.

    False where another process holds it (never with `wait`). Raises NoLocksError where the file
    system has no locks and LEGOWORLD_UNLOCKED is not 1.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        if os.environ.get(UNLOCKED) != "1":
            raise NoLocksError(
                f"{place} is on a file system without locks",
                found=cause(error),
                expected="flock, so that two processes cannot write into one folder",
                next_step=f"use a local folder; or set {UNLOCKED}=1 where no other process writes "
                "there",
            ) from error
    return True


@contextmanager
def held_alone(path: Path, refused: Exception) -> Iterator[None]:
    """Hold a lock's file for this process, which makes it; raises `refused` while another holds it.

    Its file stays: removing it would let two processes lock two files of one name.
    """
    with path.open("ab") as stream:
        if not take(stream.fileno(), path.parent, wait=False):
            raise refused
        yield


@contextmanager
def held_folder(folder: Path, refused: Exception | None = None) -> Iterator[None]:
    """Hold a folder itself, which is made: no file is left in it.

    Raises `refused` while another process holds it; without one, waits for it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        if not take(descriptor, folder, wait=refused is None) and refused is not None:
            raise refused
        yield
    finally:
        os.close(descriptor)
