"""Opening an untrusted .blend: scripts off, no UI, and typed errors."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import bpy

from legoworld.errors import MissingLibraryError, UnreadableBlendError
from legoworld.pluralize import first_few
from legoworld.scene.blender.dependencies import library_path
from legoworld.scene.blender.outside_files import (
    font_warnings,
    refuse_irregular_files,
    refuse_irregular_libraries,
)
from legoworld.scene.blender.shipped import is_needed, read_own_copies
from legoworld.scene.blender.viewport import detach_viewport

_MARKER: Final = "legoworld_not_replaced"

#: Kinds of data the view or a surface's shape, place or visibility can depend on, as bpy.data
#: names them.
_SHAPING: Final = (
    "actions", "armatures", "cameras", "collections", "curves", "fonts", "hair_curves", "lattices",
    "materials", "meshes", "metaballs", "node_groups", "objects", "particles", "pointclouds",
    "scenes", "shape_keys", "textures", "volumes",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class OpenFile:
    """The open file's active scene, how many it has, and what to warn about.

    The context may have another scene, one that is not the file's: see `viewport`.
    """

    scene: bpy.types.Scene
    n_scenes: int
    warnings: list[str]


def open_blend(path: Path) -> OpenFile:
    """Make `path` the open file.

    Raises UnreadableBlendError if Blender cannot read it, MissingLibraryError if it links missing
    data, IrregularFileError if it reads a FIFO, socket or device.
    """
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
    bpy.context.scene[_MARKER] = 1
    complaint = ""
    refuse_irregular_libraries(path)
    with detach_viewport() as file_scene:
        try:
            bpy.ops.wm.open_mainfile(
                filepath=str(path), load_ui=False, use_scripts=False, display_file_selector=False
            )
        except RuntimeError as error:
            complaint = _without_folders(str(error))
    scene = file_scene()
    # Blender raises for some files although it has loaded them: the marker tells.
    if scene is None or _MARKER in scene:
        raise UnreadableBlendError(
            "Blender cannot read scene.blend",
            found=complaint or "the file was left unopened without a message",
            expected="a file saved by Blender 2.5 to 5.0",
            next_step="save the scene again, or run its program with `legoworld execute`",
        )
    refuse_irregular_files()
    read_own_copies()
    _refuse_missing_libraries()
    warnings = [f"Blender complained on opening: {complaint}"] if complaint else []
    warnings += font_warnings()
    if tuple(bpy.data.version) > tuple(bpy.app.version_file):
        saved_by = ".".join(map(str, bpy.data.version))
        warnings.append(
            f"the file was saved by a newer Blender ({saved_by}) than the one that reads it "
            f"({bpy.app.version_string}): what that one does not know is lost"
        )
    n_local = sum(other.library is None for other in bpy.data.scenes)
    n_scenes = n_local - (scene != bpy.context.scene)
    return OpenFile(scene=scene, n_scenes=n_scenes, warnings=warnings)


def _refuse_missing_libraries() -> None:
    missing = sorted(
        f"{Path(library.filepath).name!r} does not exist"
        for library in bpy.data.libraries
        if is_needed(library) and not library_path(library).exists()
    )
    missing += sorted(
        f"{type(block).__name__.lower()} {block.name!r} is not in "
        f"{Path(block.library.filepath).name!r}"
        for kind in _SHAPING
        for block in getattr(bpy.data, kind)
        if block.is_missing and block.library
    )
    if missing:
        raise MissingLibraryError(
            "scene.blend links data that is not there",
            found=first_few(missing, 5),
            expected="every linked library beside the scene, at its relative path",
            next_step="deliver the libraries too, or make the data local before saving",
        )


def _without_folders(message: str) -> str:
    """Blender's message with the folders of all paths removed: results contain no local paths."""
    text = re.sub(r"(?:[A-Za-z]:)?(?:[\\/][^\\/\s'\",:]+)+[\\/]", "", message)
    return " ".join(text.split()).removeprefix("Error: ")
