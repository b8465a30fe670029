"""A process that exchanges a file or folder for a link to another one, as fast as it can."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from waiting import until

#: A file that is in both folders: "inside" in the one, "outside" in the other.
OUTSIDE: Final = "victim"
#: Tries of a test. A path that is looked at and then opened is led out within tens of them.
SWAPS: Final = 300

#: renameat2 with RENAME_EXCHANGE: there is always one of the two under the name.
_SWAP = """
import ctypes, os, sys
name, outside = sys.argv[1:]
libc, at_cwd, exchange = ctypes.CDLL(None), -100, 2
libc.prctl(1, 9)  # it ends with the test
os.symlink(outside, name + ".link")
pair = os.fsencode(name), os.fsencode(name + ".link")
print("begun", flush=True)
while True:
    if libc.renameat2(at_cwd, pair[0], at_cwd, pair[1], exchange):
        os._exit(1)
"""


@contextlib.contextmanager
def swapping(name: Path, outside: Path) -> Iterator[None]:
    """Exchange `name`, which is made, for a link to `outside` until the block ends.

    Where `outside` is a folder, each of the two has a file OUTSIDE.
    """
    if outside.is_dir():
        name.mkdir()
        (name / OUTSIDE).write_text("inside", encoding="utf-8")
        (outside / OUTSIDE).write_text("outside", encoding="utf-8")
    else:
        name.write_text("inside", encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", _SWAP, str(name), str(outside)],
        stdout=subprocess.PIPE,
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"begun\n"
            until(lambda: name.is_symlink())
            yield
            assert process.poll() is None, "nothing was swapped"
        finally:
            process.kill()
