"""Which triangle each pixel shows, and where on it: what normals and textures are read from."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility.kernel import level, on_cache_lines, prepare, raise_for
from legoworld.visibility.library import HitsStruct, library
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import Buffers, Surfaces


@dataclass(frozen=True, kw_only=True)
class Hits:
    """The triangle hit at each pixel centre.

    buffers: the same bytes as `kernel.render` returns. placement: (H, W) int32, index into the
    placements of the surfaces; triangle: (H, W) int32, index into the triangles of the placement's
    mesh (add triangle_start of the mesh for the index into all triangles); both -1 where nothing
    is shown. Where triangles of one instance tie in stored depth, the lowest (placement, triangle)
    is taken.

    barycentric: (H, W, 2) float32 or None, the perspective-correct weights of corners 1 and 2 at
    the pixel centre; corner 0 has the rest. normal_cam: (H, W, 3) float32 or None, the unit normal
    of the triangle's plane in the camera frame, towards the camera. Both NaN where nothing is
    shown. flipped_px: pixels at which the front of the triangle, the side from which its corners
    run anticlockwise in the mesh's own frame, faces away from the camera; 0 without normal_cam.
    """

    buffers: Buffers
    placement: NDArray[np.int32]
    triangle: NDArray[np.int32]
    barycentric: NDArray[np.float32] | None
    normal_cam: NDArray[np.float32] | None
    flipped_px: int


def render_hits(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    *,
    depth_scale: float = 1.0,
    threads: int | None = None,
    barycentric: bool = False,
    normal: bool = False,
) -> Hits:
    """Render as `kernel.render` does, and also return the triangle of each pixel.

    barycentric, normal: also compute the weights of the corners, or the normals.
    Raises as `kernel.render` does.
    """
    call = prepare(surfaces, projection, size_wh, depth_scale, threads)
    width, height = size_wh
    instance = on_cache_lines(height, width).view(np.int32)
    depth_z_m = on_cache_lines(height, width).view(np.float32)
    placement, triangle = (np.empty((height, width), np.int32) for _ in range(2))
    weights = np.empty((height, width, 2), np.float32) if barycentric else None
    normals = np.empty((height, width, 3), np.float32) if normal else None
    hits = HitsStruct(
        placement=placement.ctypes.data,
        triangle=triangle.ctypes.data,
        barycentric=None if weights is None else weights.ctypes.data,
        normal=None if normals is None else normals.ctypes.data,
        flipped=0,
    )
    status = library().lw_render(
        ctypes.byref(call.surfaces),
        ctypes.byref(call.view),
        ctypes.c_int32(call.threads),
        ctypes.c_int32(level()),
        ctypes.c_void_p(instance.ctypes.data),
        ctypes.c_void_p(depth_z_m.ctypes.data),
        ctypes.byref(hits),
    )
    raise_for(status)
    return Hits(
        buffers=Buffers(instance=instance, depth_z_m=depth_z_m),
        placement=placement,
        triangle=triangle,
        barycentric=weights,
        normal_cam=normals,
        flipped_px=int(hits.flipped),
    )
