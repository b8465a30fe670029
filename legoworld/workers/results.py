"""Moving files out of a folder that an untrusted program could write to."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from legoworld.files import refused_by_machine


def take_file(folder: Path, name: str, into: Path) -> bool:
    """Move a file from a sandbox into one of our folders; False if it does not exist.

    Only a regular file with a single name is taken: links, FIFOs and devices are neither followed
    nor opened. ValueError says what was found instead of a file.
    """
    try:
        source = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError("no folder to look in") from None
    except OSError as error:
        raise ValueError(error.strerror) from error
    try:
        os.rename(name, into / name, src_dir_fd=source)
    except FileNotFoundError:
        return False
    except OSError as error:  # a folder in its place, or one that is closed to us
        if refused_by_machine(error):
            raise
        raise ValueError(error.strerror) from error
    finally:
        os.close(source)
    status = (into / name).lstat()
    if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1:
        kind = "a file with another name, too" if stat.S_ISREG(status.st_mode) else "no plain file"
        raise ValueError(kind)
    (into / name).chmod(0o644)
    return True
