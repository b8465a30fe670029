"""The other files an open .blend reads."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy


def dependencies(blend: Path) -> list[str]:
    """Linked libraries, unpacked images, caches and so on, there or not, sorted.

    Paths are relative to the .blend's folder; one that the file gives as an absolute path outside
    of that folder stays absolute, because it means the same wherever the scene stands.
    """
    folder = blend.parent
    absolute = bpy.utils.blend_paths(absolute=True, packed=False, local=False)
    written = bpy.utils.blend_paths(absolute=False, packed=False, local=False)
    found = {
        _name(Path(path), raw, folder) for path, raw in zip(absolute, written, strict=True) if path
    }
    for library in bpy.data.libraries:
        if library.packed_file is None:
            found.add(_name(library_path(library), library.filepath, folder))
    for cache in _cache_folders(blend):
        found |= {_name(p, "//", folder) for p in cache.rglob("*") if p.is_file()}
    found.discard(blend.name)
    return sorted(found)


def library_path(library: Any) -> Path:
    """Where a linked library's file is; its own path may be relative to the library it is in."""
    return Path(bpy.path.abspath(library.filepath, library=library.parent))


def _name(path: Path, written: str, folder: Path) -> str:
    normal = os.path.normpath(path)
    relative = os.path.relpath(normal, folder)
    if written.startswith("//") or not relative.startswith(os.pardir):
        return relative
    return normal


def _cache_folders(blend: Path) -> list[Path]:
    """Folders of simulations and bakes, which Blender's own list leaves out."""
    folders = {blend.parent / f"blendcache_{blend.stem}"}
    for block in bpy.data.objects:
        for modifier in block.modifiers:
            folders |= {_absolute(d, block) for d in _cache_settings(modifier)}
    return sorted(folder for folder in folders if folder.is_dir())


def _cache_settings(modifier: Any) -> list[str]:
    if modifier.type == "NODES" and modifier.bake_directory:
        return [modifier.bake_directory]
    if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN":
        return [modifier.domain_settings.cache_directory]
    return []


def _absolute(directory: str, block: Any) -> Path:
    return Path(bpy.path.abspath(directory, library=block.library))
