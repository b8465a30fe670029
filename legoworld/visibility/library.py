"""Finds and loads the compiled kernel, and refuses one that is not built from the sources here."""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import ClassVar

from legoworld.errors import KernelBuildError, cause
from legoworld.visibility.compilation import LIBRARY_NAME, source_hash, sources

REBUILD = "in a checkout: pip install -e . ; otherwise install legoworld again"


class AlphaStruct(ctypes.Structure):
    """LwAlpha of scene.hpp."""

    _fields_: ClassVar = [
        ("texels", ctypes.c_void_p),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("wrap", ctypes.c_int32),
        ("linear", ctypes.c_int32),
        ("sides", ctypes.c_int32),
    ]


class SurfacesStruct(ctypes.Structure):
    """LwSurfaces of scene.hpp."""

    _fields_: ClassVar = [
        ("vertices", ctypes.c_void_p),
        ("triangles", ctypes.c_void_p),
        ("vertex_start", ctypes.c_void_p),
        ("triangle_start", ctypes.c_void_p),
        ("meshes", ctypes.c_int64),
        ("placement_mesh", ctypes.c_void_p),
        ("cam_from_mesh", ctypes.c_void_p),
        ("placement_id", ctypes.c_void_p),
        ("placements", ctypes.c_int64),
        ("triangle_cutout", ctypes.c_void_p),
        ("corner_uv", ctypes.c_void_p),
        ("corner_alpha", ctypes.c_void_p),
        ("alphas", ctypes.c_void_p),
        ("threshold", ctypes.c_double),
    ]


class ViewStruct(ctypes.Structure):
    """LwView of scene.hpp."""

    _fields_: ClassVar = [
        ("fx", ctypes.c_double),
        ("fy", ctypes.c_double),
        ("cx", ctypes.c_double),
        ("cy", ctypes.c_double),
        ("z_near", ctypes.c_double),
        ("z_far", ctypes.c_double),
        ("depth_scale", ctypes.c_double),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("orthographic", ctypes.c_int32),
    ]


class HitsStruct(ctypes.Structure):
    """LwHits of scene.hpp."""

    _fields_: ClassVar = [
        ("placement", ctypes.c_void_p),
        ("triangle", ctypes.c_void_p),
        ("barycentric", ctypes.c_void_p),
        ("normal", ctypes.c_void_p),
        ("corner_normal", ctypes.c_void_p),
        ("flipped", ctypes.c_int64),
    ]


#: LwAllocate of scene.hpp.
Allocate = ctypes.CFUNCTYPE(
    ctypes.c_int32,
    ctypes.c_int64,
    ctypes.POINTER(ctypes.c_void_p),
    ctypes.POINTER(ctypes.c_void_p),
)


class LayersStruct(ctypes.Structure):
    """LwLayers of scene.hpp."""

    _fields_: ClassVar = [
        ("instances", ctypes.c_int64),
        ("ident", ctypes.c_void_p),
        ("most", ctypes.c_int64),
        ("allocate", Allocate),
        ("start", ctypes.c_void_p),
    ]


@functools.cache
def library() -> ctypes.CDLL:
    """The kernel, loaded once per process. Calls through it release the GIL.

    Raises KernelBuildError when it is missing, cannot be loaded, or was compiled from other sources
    than the ones beside it.
    """
    return load_library(Path(__file__).parent)


def load_library(folder: Path) -> ctypes.CDLL:
    """The kernel of `folder`; see library()."""
    loaded = open_library(folder, "visibility kernel")
    for name in ("lw_render", "lw_layers", "lw_coverage", "lw_best_level", "lw_extents"):
        getattr(loaded, name).restype = ctypes.c_int32
    loaded.lw_masks.restype = ctypes.c_int64
    return loaded


def open_library(folder: Path, what: str) -> ctypes.CDLL:
    """The compiled library of a folder; see library(). KernelBuildError, which calls it `what`."""
    path = folder / LIBRARY_NAME
    if not path.is_file():
        raise KernelBuildError(
            f"the {what} was not compiled", expected=path.name, next_step=REBUILD
        )
    try:
        loaded = ctypes.CDLL(str(path))
    except OSError as error:
        raise KernelBuildError(
            f"the {what} cannot be loaded", found=cause(error), next_step=REBUILD
        ) from error
    loaded.lw_source_hash.restype = ctypes.c_char_p
    built_from = loaded.lw_source_hash().decode()
    if sources(folder) and built_from != source_hash(folder):
        raise KernelBuildError(
            f"the {what} is older than its sources",
            found=f"built from {built_from[:12]}",
            expected=source_hash(folder)[:12],
            next_step=REBUILD,
        )
    return loaded
