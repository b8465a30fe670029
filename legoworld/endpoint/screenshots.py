"""Where a picture of the scene goes: the client names a file, and not every file may be written."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from legoworld.errors import LegoWorldError
from legoworld.workers.results import take_file


class NotShownError(LegoWorldError):
    """A client names a file that the endpoint does not write."""

    code = "endpoint_file"


def may_be_written(path: str, workspace: Path) -> bool:
    """Whether a path leads into the workspace, links followed."""
    return Path(path).resolve().is_relative_to(workspace.resolve())


def deliver_picture(folder: Path, name: str, wanted: str, workspace: Path) -> None:
    """Move Blender's picture to the path that a client asked for.

    That is a file in the workspace, or a new .png directly in the folder for temporary files, where
    mcp-for-blender looks for it. Raises NotShownError for any other.
    """
    path = Path(wanted)
    temporary = Path(tempfile.gettempdir()).resolve()
    inside = may_be_written(wanted, workspace)
    if not inside and not (path.suffix == ".png" and path.parent.resolve() == temporary):
        raise NotShownError(
            "a screenshot is not written there",
            found=wanted or "no filepath",
            expected=f"a path below {workspace.resolve()}, or a new .png in {temporary}",
            next_step="start mcp-for-blender with TMPDIR set to the workspace",
        )
    try:
        if not take_file(folder, name, folder.parent):
            raise NotShownError("Blender left no picture", found="no file")
    except ValueError as error:
        raise NotShownError("Blender left no picture", found=str(error)) from error
    data = (folder.parent / name).read_bytes()
    (folder.parent / name).unlink()
    flags = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    # In a folder that others write to, nothing that is there is overwritten.
    flags |= os.O_TRUNC if inside else os.O_EXCL
    with os.fdopen(os.open(path, flags, 0o644), "wb") as stream:
        stream.write(data)
