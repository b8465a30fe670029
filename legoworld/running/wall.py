"""The wall around reading one image: what a scene can cause is its verdict, and the run continues.

What is this machine's (a full disk, a broken installation) would meet every other image, too, and
ends the run with its own error.
"""

from __future__ import annotations

import errno
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from legoworld.errors import InstallationError, KernelBuildError, LegoWorldError, SceneInvalidError
from legoworld.files import refused_by_machine

_BROKEN: Final = (KernelBuildError, InstallationError, ImportError)


class UnforeseenError(LegoWorldError):
    """Reading a scene ended in an exception that no verdict foresees."""

    code = "unforeseen"


def judged(error: Exception, written: Iterable[Path]) -> LegoWorldError:
    """The verdict of a scene whose reading raised `error`; raises it when it is the machine's.

    written: the folders that the program writes into; a refusal there is never the scene's fault,
    unless a name of the scene is too long for it.
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
            found=error.strerror or type(error).__name__,
            expected="files that may be read, with names the file system takes",
            next_step="correct the file or its name",
        )
    frame = traceback.extract_tb(error.__traceback__)[-1]
    unforeseen = UnforeseenError(
        "reading the scene failed in a way that was not foreseen",
        found=f"{type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})",
        expected="a record or a named verdict",
        next_step="please report it with the scene and what -v prints; the other scenes are read",
    )
    unforeseen.trace = "".join(traceback.format_exception(error))
    return unforeseen


def _is_below(filename: object, folders: Iterable[Path]) -> bool:
    if not isinstance(filename, str):
        return False
    return any(Path(filename).is_relative_to(folder) for folder in folders)
