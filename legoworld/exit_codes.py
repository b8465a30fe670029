"""What the exit code of a command means, for scripts and schedulers."""

from __future__ import annotations

import errno
from typing import Final

#: Everything was done.
DONE: Final = 0
#: The command finished; some images have no result, or a check it makes does not hold.
INCOMPLETE: Final = 1
#: Wrong usage, or an input that cannot be used: another call is needed.
UNUSABLE: Final = 2
#: Finished; a threshold (--fail-below) does not hold.
BELOW: Final = 3
#: Not finished for a reason outside the input: the same call can succeed elsewhere or later.
BLOCKED: Final = 4
#: Ctrl-C.
INTERRUPTED: Final = 130

MEANING: Final = {
    DONE: "done",
    INCOMPLETE: "finished, but some images have no result or a check does not hold; the output "
    "says which and why",
    UNUSABLE: "wrong usage, or an input that cannot be used",
    BELOW: "finished, but a `--fail-below` threshold does not hold",
    BLOCKED: "not finished for a reason outside the input: a full or read-only disk, a broken "
    "installation, an unreachable store, a lost cluster, a defect of legoworld",
    INTERRUPTED: "stopped with Ctrl-C",
}

#: What the system says of a path that was named wrongly, as opposed to one that it cannot serve.
_WRONG_PATH: Final = (
    errno.ENOENT,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.EEXIST,
    errno.ENAMETOOLONG,
    errno.ELOOP,
    errno.EINVAL,
)


def of_os_error(error: OSError) -> int:
    """UNUSABLE where the path is wrong, BLOCKED where the system cannot do what is asked."""
    return UNUSABLE if error.errno in _WRONG_PATH else BLOCKED
