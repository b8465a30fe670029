"""The error boundary around reading one image: a scene's failure is recorded, the run continues.

Failures of this machine (a full disk, a broken installation) would affect every other image, too,
and end the run with their own error.
"""

from __future__ import annotations

import errno
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from legoworld.errors import (
    InstallationError,
    KernelBuildError,
    LegoWorldError,
    SceneInvalidError,
    cause,
)
from legoworld.files import refused_by_machine
from legoworld.scene.cache import CacheFolderError

_BROKEN: Final = (KernelBuildError, InstallationError, CacheFolderError, ImportError)


class UnforeseenError(LegoWorldError):
    """Reading a scene raised an unexpected exception."""

    code = "unforeseen"


def classify_error(error: Exception, written: Iterable[Path]) -> LegoWorldError:
    """The error of a scene whose reading raised `error`; re-raises errors of the machine.

    written: the folders that the program writes into; a refusal there is never the scene's fault,
    unless a name from the scene is too long.
    """
    if isinstance(error, _BROKEN):
        raise error
    if isinstance(error, LegoWorldError):
        return error
    if isinstance(error, OSError):
        if refused_by_machine(error) or (
            error.errno != errno.ENAMETOOLONG and _is_below(error.filename, written)
        ):
            raise error
        return SceneInvalidError(
            "a file of the scene cannot be used",
            found=cause(error),
            expected="files that may be read, with names the file system takes",
            next_step="correct the file or its name",
        )
    frame = traceback.extract_tb(error.__traceback__)[-1]
    unforeseen = UnforeseenError(
        "unexpected error while reading the scene",
        found=f"{type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})",
        expected="a record or a named verdict",
        next_step="this is a bug in legoworld, please report it (-v prints the traceback); "
        "the other scenes are read",
    )
    unforeseen.trace = "".join(traceback.format_exception(error))
    return unforeseen


def _is_below(filename: str | bytes | int | None, folders: Iterable[Path]) -> bool:
    if not isinstance(filename, str):
        return False
    return any(Path(filename).is_relative_to(folder) for folder in folders)
