"""The visibility kernel: which instance, and how far, at every pixel centre.

A float64 z-buffer rasteriser in C++ (kernel.cpp), loaded with ctypes. It computes what the ideal
ray through each pixel centre hits first, double-sided, with z_near and z_far applied per sample.
At equal stored depth the lower instance id wins. Output is bit-identical for any number of
threads, any order of placements, meshes and triangles, and any instruction set.
"""

from __future__ import annotations

import ctypes
import functools
import math
import os
import weakref
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, ShapeError
from legoworld.visibility.library import (
    AlphaStruct,
    HitsStruct,
    SurfacesStruct,
    ViewStruct,
    library,
)
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import (
    HOLDOUT,
    SIDES,
    WRAPS,
    Buffers,
    Cutouts,
    Surfaces,
    check_surfaces,
)
from legoworld.workers.processors import usable_cores

__all__ = ["HOLDOUT", "MAX_SIDE", "Buffers", "Cutouts", "Surfaces", "coverage", "render"]

#: Largest width and height of a picture, pixels.
MAX_SIDE = 8192

#: Set to one of LEVELS to keep the kernel from using wider vectors; the bytes are the same.
LEVEL_VARIABLE = "LEGOWORLD_KERNEL_LEVEL"
LEVELS = ("baseline", "avx2")

#: Memory of earlier pictures: at most 64 MiB.
_LARGEST_KEPT = 4 << 20
_unused: deque[NDArray[np.uint8]] = deque(maxlen=16)

#: More threads than this are slower.
MAX_THREADS = 64

STATUS_MESSAGES = {
    1: "the visibility kernel ran out of memory",
    2: "a vertex is NaN or infinite",
    3: "a triangle's vertex index is outside its mesh",
}


@dataclass(frozen=True, kw_only=True)
class Call:
    """The C side of the arguments, and the Python objects whose memory it points into."""

    surfaces: SurfacesStruct
    view: ViewStruct
    threads: int
    keep_alive: Any


def render(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    *,
    depth_scale: float = 1.0,
    threads: int | None = None,
) -> Buffers:
    """Instance and depth of the nearest surface at each pixel centre.

    size_wh: pixels, in [1, 8192] each; depth_scale: metres per scene unit, multiplies z in float64
    before it is rounded to float32; threads: None = one per CPU this process may use. If the
    system starts fewer threads, the output is the same.
    Raises ShapeError for arrays or numbers the kernel cannot work with, KernelBuildError when the
    library is missing or stale, LegoWorldError when memory runs out.
    """
    return render_into(None, surfaces, projection, size_wh, depth_scale, threads)


def render_into(
    hits: HitsStruct | None,
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    depth_scale: float,
    threads: int | None,
) -> Buffers:
    """Render, and fill the arrays that `hits` points to."""
    call = prepare(surfaces, projection, size_wh, depth_scale, threads)
    instance = on_cache_lines(size_wh[1], size_wh[0]).view(np.int32)
    depth_z_m = on_cache_lines(size_wh[1], size_wh[0]).view(np.float32)
    status = library().lw_render(
        ctypes.byref(call.surfaces),
        ctypes.byref(call.view),
        ctypes.c_int32(call.threads),
        ctypes.c_int32(level()),
        ctypes.c_void_p(instance.ctypes.data),
        ctypes.c_void_p(depth_z_m.ctypes.data),
        None if hits is None else ctypes.byref(hits),
    )
    raise_for(status)
    return Buffers(instance=instance, depth_z_m=depth_z_m)


def coverage(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    *,
    threads: int | None = None,
) -> NDArray[np.uint8]:
    """Visibility class of each placement drawn alone: (P,) uint8.

    5: it covers a pixel centre within [z_near, z_far] (if unseen, it is occluded or removed by
    its own alpha); 4: in view, but between pixel centres; 3: outside the view;
    2: entirely beyond z_far; 1: entirely nearer than z_near, or behind the camera; 0: no triangle,
    or none with an area. The highest code of its triangles counts. Raises as render() does.
    """
    call = prepare(surfaces, projection, size_wh, 1.0, threads)
    reach = np.zeros(len(surfaces.placement_mesh), np.uint8)
    status = library().lw_coverage(
        ctypes.byref(call.surfaces),
        ctypes.byref(call.view),
        ctypes.c_int32(call.threads),
        ctypes.c_void_p(reach.ctypes.data),
    )
    raise_for(status)
    return reach


def prepare(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    depth_scale: float,
    threads: int | None,
) -> Call:
    """Check the arguments of a call into the library and lay them out for it. ShapeError."""
    check_surfaces(surfaces)
    _check_view(projection, size_wh, depth_scale)
    if threads is not None and threads < 1:
        raise ShapeError("threads is not a count", found=str(threads), expected="at least 1")
    count = usable_cores() if threads is None else threads
    view = ViewStruct(
        fx=projection.fx,
        fy=projection.fy,
        cx=projection.cx,
        cy=projection.cy,
        z_near=projection.z_near,
        z_far=projection.z_far,
        depth_scale=depth_scale,
        width=size_wh[0],
        height=size_wh[1],
        orthographic=int(projection.orthographic),
    )
    struct, keep_alive = _surfaces_struct(surfaces)
    return Call(surfaces=struct, view=view, threads=min(count, MAX_THREADS), keep_alive=keep_alive)


def _surfaces_struct(surfaces: Surfaces) -> tuple[SurfacesStruct, Any]:
    struct = SurfacesStruct(
        vertices=surfaces.vertices.ctypes.data,
        triangles=surfaces.triangles.ctypes.data,
        vertex_start=surfaces.vertex_start.ctypes.data,
        triangle_start=surfaces.triangle_start.ctypes.data,
        meshes=len(surfaces.vertex_start) - 1,
        placement_mesh=surfaces.placement_mesh.ctypes.data,
        cam_from_mesh=surfaces.cam_from_mesh.ctypes.data,
        placement_id=surfaces.placement_id.ctypes.data,
        placements=len(surfaces.placement_mesh),
        triangle_cutout=None,
        corner_uv=None,
        corner_alpha=None,
        alphas=None,
        threshold=0.0,
    )
    cutouts = surfaces.cutouts
    if cutouts is None or not cutouts.alphas:
        return struct, surfaces
    alphas = (AlphaStruct * len(cutouts.alphas))(
        *(
            AlphaStruct(
                texels=alpha.ctypes.data,
                width=alpha.shape[1],
                height=alpha.shape[0],
                wrap=WRAPS.index(wrap),
                linear=int(interpolation == "linear"),
                sides=SIDES.index(sides),
            )
            for alpha, wrap, interpolation, sides in zip(
                cutouts.alphas, cutouts.wrap, cutouts.interpolation, cutouts.sides, strict=True
            )
        )
    )
    struct.triangle_cutout = cutouts.triangle_cutout.ctypes.data
    struct.corner_uv = cutouts.corner_uv.ctypes.data
    if cutouts.corner_alpha is not None:
        struct.corner_alpha = cutouts.corner_alpha.ctypes.data
    struct.alphas = ctypes.addressof(alphas)
    struct.threshold = cutouts.threshold
    return struct, (surfaces, alphas)


def _check_view(projection: Projection, size_wh: tuple[int, int], depth_scale: float) -> None:
    if not all(1 <= side <= MAX_SIDE for side in size_wh):
        raise ShapeError(
            "the picture size is out of range",
            found=f"{size_wh[0]}x{size_wh[1]}",
            expected=f"1..{MAX_SIDE} pixels each way",
        )
    p = projection
    numbers = (p.fx, p.fy, p.cx, p.cy, p.z_near, p.z_far, depth_scale)
    largest = float(np.finfo(np.float32).max)
    sound = (
        all(math.isfinite(x) for x in numbers)
        and all(1e-9 <= f <= 1e12 for f in (p.fx, p.fy))
        and all(abs(c) <= 1e9 for c in (p.cx, p.cy))
        and p.z_near < p.z_far
        and (p.orthographic or p.z_near > 0)
        and depth_scale > 0
        and max(abs(p.z_near), abs(p.z_far)) * depth_scale <= largest
    )
    if not sound:
        raise ShapeError(
            "the projection is not one the kernel can work with",
            found=f"{p}, depth_scale={depth_scale}",
            expected="finite numbers, fx and fy in 1e-9..1e12, z_near < z_far, z_near > 0 in "
            "perspective, depth_scale > 0, z_far * depth_scale within float32",
        )


def on_cache_lines(height: int, width: int) -> NDArray[np.uint32]:
    """(H, W) without initial values that begins on a cache line: rows can be written past it.

    The memory of a picture that is not used any more is used again: its pages are there already,
    and making them costs a third of a small picture.
    """
    line, count = 64, height * width
    memory = None
    with suppress(IndexError):
        memory = _unused.pop()
    if memory is None or not 4 * count + line <= memory.nbytes <= 8 * count + line:
        memory = np.empty(4 * count + line, np.uint8)
    start = -memory.ctypes.data % line
    if memory.nbytes > _LARGEST_KEPT:
        return memory[start : start + 4 * count].view(np.uint32).reshape(height, width)
    lines = (ctypes.c_uint32 * count).from_buffer(memory.data, start)  # what every view of it holds
    weakref.finalize(lines, _unused.append, memory).atexit = False
    return np.frombuffer(memoryview(lines), np.uint32).reshape(height, width)


def level() -> int:
    """Index of the instruction set: the CPU's best, or LEVEL_VARIABLE's. LegoWorldError."""
    wanted = os.environ.get(LEVEL_VARIABLE, "")
    best = _best_level()
    if not wanted:
        return best
    if wanted not in LEVELS:
        raise LegoWorldError(
            f"{LEVEL_VARIABLE} is unknown", found=wanted, expected=f"{' or '.join(LEVELS)}, or none"
        )
    return min(LEVELS.index(wanted), best)


@functools.cache
def _best_level() -> int:
    """Asked once: on a virtual machine the CPU answers by way of the host, in a tenth of a ms."""
    return int(library().lw_best_level())


def raise_for(status: int) -> None:
    """LegoWorldError or ShapeError, as a status of the library says; 0 is success."""
    if status == 1:
        raise LegoWorldError(STATUS_MESSAGES[1], next_step="use a smaller picture or fewer workers")
    if status != 0:
        raise ShapeError(STATUS_MESSAGES[status])
