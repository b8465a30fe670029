"""What the exit code of a command means, for scripts and schedulers."""

from __future__ import annotations

import errno
from typing import Final

#: Everything was done.
DONE: Final = 0
#: The command finished, but some images have no result or a check failed.
INCOMPLETE: Final = 1
#: Wrong usage or an unusable input: the same call cannot succeed.
UNUSABLE: Final = 2
#: Finished, but a --fail-below threshold is not met.
BELOW: Final = 3
#: Not finished for a reason outside the input: the same call can succeed elsewhere or later.
BLOCKED: Final = 4
#: Nothing to certify or score, or it cannot be read: neither yes nor no, and no number.
NOT_ASSESSED: Final = 5
#: Ctrl-C.
INTERRUPTED: Final = 130

MEANING: Final = {
    DONE: "done",
    INCOMPLETE: "finished, but some images have no result or a check failed; the output says which "
    "and why",
    UNUSABLE: "wrong usage or an unusable input",
    BELOW: "finished, but a `--fail-below` threshold is not met",
    BLOCKED: "not finished for a reason outside the input: a full or read-only disk, a broken "
    "installation, an unreachable store, a lost cluster, a bug in legoworld",
    NOT_ASSESSED: "not assessed: there is nothing to certify or score, or it cannot be read; no "
    "verdict and no number",
    INTERRUPTED: "stopped with Ctrl-C",
}

#: System errors that mean a wrong path, as opposed to a path the system cannot serve.
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
    """UNUSABLE for a wrong path, BLOCKED where the system cannot do what was asked."""
    return UNUSABLE if error.errno in _WRONG_PATH else BLOCKED
