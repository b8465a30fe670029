"""Opening a foreign .blend: scripts off, no UI, and a typed verdict for what cannot be used."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from legoworld.errors import MissingLibraryError, UnreadableBlendError

_MARKER = "legoworld_not_replaced"


def open_blend(path: Path) -> list[str]:
    """Make `path` the open file; returns warnings.

    Raises UnreadableBlendError when Blender cannot read it, MissingLibraryError when it links
    data that is not there.
    """
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
    bpy.context.scene[_MARKER] = 1
    warnings = []
    try:
        bpy.ops.wm.open_mainfile(
            filepath=str(path), load_ui=False, use_scripts=False, display_file_selector=False
        )
    except RuntimeError as error:
        # Blender raises for some files although it has loaded them: the marker tells.
        if bpy.context.scene is None or _MARKER in bpy.context.scene:
            raise UnreadableBlendError(
                "Blender cannot read scene.blend",
                found=_without_paths(str(error), path),
                expected="a file saved by Blender 2.5 to 5.0",
                next_step="save the scene again, or run its program with `legoworld execute`",
            ) from error
        warnings.append(f"Blender complained on opening: {_without_paths(str(error), path)}")
    if bpy.context.scene is None or _MARKER in bpy.context.scene:
        raise UnreadableBlendError(
            "Blender did not load scene.blend",
            found="the file was left unopened without a message",
            expected="a file saved by Blender 2.5 to 5.0",
            next_step="save the scene again",
        )
    _refuse_missing_libraries()
    return warnings


def dependencies(blend: Path) -> list[str]:
    """Every other file the open .blend reads, as sorted paths relative to its folder."""
    found = set()
    for name in bpy.utils.blend_paths(absolute=True, packed=False, local=False):
        if name:
            found.add(os.path.relpath(os.path.normpath(name), blend.parent))
    for library in bpy.data.libraries:
        if library.packed_file is None:
            absolute = bpy.path.abspath(library.filepath, library=library.parent)
            found.add(os.path.relpath(os.path.normpath(absolute), blend.parent))
    found.discard(blend.name)
    return sorted(found)


def _refuse_missing_libraries() -> None:
    missing_files = {
        library.filepath
        for library in bpy.data.libraries
        if library.packed_file is None
        and not os.path.exists(bpy.path.abspath(library.filepath, library=library.parent))
    }
    missing_data = [
        f"{type(block).__name__.lower()} {block.name!r} of {block.library.filepath!r}"
        for collection in (bpy.data.objects, bpy.data.collections, bpy.data.meshes)
        for block in collection
        if block.is_missing and block.library
    ]
    if missing_files or missing_data:
        found = [f"{name!r} does not exist" for name in sorted(missing_files)] + missing_data
        raise MissingLibraryError(
            "scene.blend links data that is not there",
            found=", ".join(found[:5]) + (f" and {len(found) - 5} more" if found[5:] else ""),
            expected="every linked library beside the scene, at its relative path",
            next_step="deliver the libraries too, or make the data local before saving",
        )


def _without_paths(message: str, path: Path) -> str:
    """Blender's message with the scene's own folder taken out: results must not name a machine."""
    text = message.replace(str(path), path.name).replace(str(path.parent) + os.sep, "")
    return " ".join(text.split()).removeprefix("Error: ")
