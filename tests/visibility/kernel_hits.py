"""Which triangle each pixel shows, and where on it: what textures and normals are read from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility.kernel import render_into
from legoworld.visibility.library import HitsStruct
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
    the pixel centre, NaN where nothing is shown; corner 0 has the rest.
    """

    buffers: Buffers
    placement: NDArray[np.int32]
    triangle: NDArray[np.int32]
    barycentric: NDArray[np.float32] | None


def triangles(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    *,
    depth_scale: float = 1.0,
    threads: int | None = None,
    barycentric: bool = False,
) -> Hits:
    """Render as `kernel.render` does, with the triangle of each pixel.

    barycentric: also compute the weights of its corners. Raises as `kernel.render` does.
    """
    width, height = size_wh
    placement, triangle = (np.empty((height, width), np.int32) for _ in range(2))
    weights = np.empty((height, width, 2), np.float32) if barycentric else None
    hits = HitsStruct(
        placement=placement.ctypes.data,
        triangle=triangle.ctypes.data,
        barycentric=None if weights is None else weights.ctypes.data,
    )
    return Hits(
        buffers=render_into(hits, surfaces, projection, size_wh, depth_scale, threads),
        placement=placement,
        triangle=triangle,
        barycentric=weights,
    )
