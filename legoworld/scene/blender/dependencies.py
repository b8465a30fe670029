"""The files that an open .blend depends on."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

import bpy

from legoworld.scene.blender.shipped import is_needed, own_copy

_BLEND: Final = re.compile(r"\.blend\d*$", re.IGNORECASE)


def dependencies(blend: Path) -> list[str]:
    """Linked libraries, unpacked images, caches and other files, existing or not, sorted.

    Paths are relative to the .blend's folder; one that the file gives as an absolute path outside
    of that folder stays absolute, because it means the same wherever the scene stands. What ships
    with Blender is not among them: its version vouches for it.
    """
    folder = blend.parent
    libraries = [library for library in bpy.data.libraries if is_needed(library)]
    absolute = bpy.utils.blend_paths(absolute=True, packed=False, local=False)
    written = bpy.utils.blend_paths(absolute=False, packed=False, local=False)
    # Data that was appended keeps the path of the .blend it came from, which is never read again,
    # and so does what is packed: Blender lists both. The others are the libraries below.
    read = {(p, raw) for p, raw in zip(absolute, written, strict=True) if not _BLEND.search(p)}
    read |= {(str(library_path(library)), library.filepath) for library in libraries}
    names = {_name(Path(p), raw, folder) for p, raw in read if p and own_copy(p) is None}
    for cache in cache_folders(blend):
        names |= {_name(p, "//", folder) for p in cache.rglob("*") if p.is_file()}
    names.discard(blend.name)
    return sorted(names)


def watched_folders(blend: Path) -> list[str]:
    """Folders whose every file an open .blend reads, there or not, named as `dependencies` are."""
    return sorted(_name(folder, "//", blend.parent) for folder in cache_folders(blend))


def library_path(library: bpy.types.Library) -> Path:
    """Where a linked library's file is.

    Blender makes relative paths of libraries that other libraries link relative to the open file.
    """
    return Path(bpy.path.abspath(library.filepath))


def _name(path: Path, written: str, folder: Path) -> str:
    normal = os.path.normpath(path)
    as_written = os.path.normpath(written.removeprefix("//").replace("\\", "/"))
    if written.startswith("//") and os.path.normpath(folder / as_written) == normal:
        return (
            as_written  # the same wherever the scene stands, also where it climbs beyond the root
        )
    relative = os.path.relpath(normal, folder)
    if written.startswith("//") or not relative.startswith(os.pardir):
        return relative
    return normal


def cache_folders(blend: Path) -> list[Path]:
    """Folders of simulations and bakes, there or not, which Blender's own list leaves out."""
    folders = {blend.parent / f"blendcache_{blend.stem}"}
    for block in bpy.data.objects:
        for modifier in block.modifiers:
            folders |= {_absolute(d, block) for d in _cache_settings(modifier)}
    return sorted(folders)


def _cache_settings(modifier: bpy.types.Modifier) -> list[str]:
    if modifier.type == "NODES" and modifier.bake_directory:
        return [modifier.bake_directory]
    if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN":
        return [modifier.domain_settings.cache_directory]
    return []


def _absolute(directory: str, block: bpy.types.ID) -> Path:
    return Path(bpy.path.abspath(directory, library=block.library))
