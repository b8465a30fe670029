"""Where a picture of the scene goes: the client names a file, and not every file may be written."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

from legoworld.beneath import Beneath, name_beneath
from legoworld.errors import LegoWorldError
from legoworld.scene.pictures import MOST_PX, PNG, claimed_size_wh

MOST_BYTES: Final = 64 << 20


class NotShownError(LegoWorldError):
    """A client names a file that the endpoint does not write."""

    code = "endpoint_file"


def deliver_picture(data: bytes | None, wanted: str, workspace: Path) -> None:
    """Write Blender's picture to the path that a client asked for.

    The path is a file in the workspace, or a new .png directly in the folder for temporary files,
    where mcp-for-blender looks for it. NotShownError for any other path, and for data that are not
    a PNG of a size clients can decode; RefusedFileError for a path that leads through a link.
    """
    _check_picture(data or b"")
    assert data is not None
    if (name := name_beneath(wanted, workspace)) is not None:
        with Beneath(workspace.resolve()) as inside:
            inside.write(name, data)
        return
    temporary = Path(tempfile.gettempdir())
    name = name_beneath(wanted, temporary)
    if name is None or name.suffix != ".png" or len(name.parts) != 1:
        raise NotShownError(
            "a screenshot is not written there",
            found=wanted or "no filepath",
            expected=f"a path below {workspace.resolve()}, or a new .png in {temporary.resolve()}",
            next_step="start mcp-for-blender with TMPDIR set to the workspace",
        )
    # Others write there: nothing that is there is overwritten.
    with Beneath(temporary.resolve()) as inside:
        inside.write(name, data, new=True)


def _check_picture(data: bytes) -> None:
    width, height = claimed_size_wh(data) if data.startswith(PNG) else (0, 0)
    if not 0 < width * height <= MOST_PX:
        raise NotShownError(
            "Blender left no picture that is shown",
            found=f"{width}x{height} pixels in {len(data):,} bytes" if width else "no PNG",
            expected=f"a PNG of at most {MOST_PX:,} pixels",
        )
