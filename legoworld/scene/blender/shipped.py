"""Files that ship with Blender: part of a version, not of a scene.

A .blend names such files (node groups that operators link, fonts, pictures) by the path they had
where it was saved. Read elsewhere, that path leads nowhere; here it is always taken for the file of
the Blender that reads.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

import bpy

#: How the folders of an installed Blender look from outside: `5.0/datafiles/fonts/Inter.woff2`.
_INSTALLED: Final = re.compile(r"[\\/]\d+\.\d+[\\/]((?:datafiles|scripts)[\\/].+)$")


def own_copy(path: str) -> Path | None:
    """The file of this Blender that a path to the same file of any Blender means; else None."""
    root = Path(bpy.utils.resource_path("LOCAL"))
    installed = _INSTALLED.search(path)
    if installed is None:
        return None
    own = root / installed[1].replace("\\", "/")
    return own if ".." not in own.parts and own.is_file() else None


def read_own_copies() -> None:
    """Have the open file's libraries, fonts and pictures that ship with Blender read from it."""
    for library in list(bpy.data.libraries):
        own = _running_copy(library)
        if own is not None and is_needed(library):
            library.filepath = str(own)
            library.reload()
    for font in list(bpy.data.fonts):
        own = _running_copy(font)
        if own is not None:
            # A font whose path changes keeps its shapes: the curves get another one instead.
            font.user_remap(bpy.data.fonts.load(str(own), check_existing=False))
            bpy.data.fonts.remove(font)
    for image in list(bpy.data.images):
        own = _running_copy(image)
        if own is not None:
            image.filepath = str(own)
            image.reload()


def is_needed(library: bpy.types.Library) -> bool:
    """Whether a library's file is read: it has data that is neither packed nor an archive."""
    if library.packed_file is not None or library.is_archive:
        return False
    return any(block.library == library for block in library.users_id)


def _running_copy(block: bpy.types.ID) -> Path | None:
    """The running Blender's copy of a block's file, where it names another Blender's."""
    if block.packed_file is not None or not block.filepath:
        return None
    path = os.path.normpath(bpy.path.abspath(block.filepath, library=block.library))
    own = own_copy(path)
    return own if own is not None and str(own) != path else None
