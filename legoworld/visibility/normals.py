"""Geometric normals: the plane of the triangle that each pixel shows.

Shading normals would interpolate the corners' normals with `Hits.barycentric`; a snapshot holds
none. It would need (T, 3, 3) float32 corner normals in the mesh's frame, as the render state has
them (custom split normals and smooth flags resolved).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility.library import HitsStruct
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import Buffers, Surfaces
from legoworld.visibility.triangles import render_into


@dataclass(frozen=True, kw_only=True)
class Normals:
    """A normal per pixel, and the buffers of the same drawing.

    normal_cam: (H, W, 3) float32, unit vectors in the OpenCV camera frame (x right, y down,
    z forward), NaN where nothing is shown. They point towards the camera: n . ray <= 0 with the
    pixel's own ray, so a frontal wall has (0, 0, -1), and n_z may be positive at wide angles.
    flipped_share: of the pixels with a normal, the share whose triangle shows its back; NaN
    without any. The front is the side from which the corners run anticlockwise in the mesh's own
    frame: a mirrored placement does not turn it.
    """

    buffers: Buffers
    normal_cam: NDArray[np.float32]
    flipped_share: float


def geometric_normals(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    *,
    depth_scale: float = 1.0,
    threads: int | None = None,
) -> Normals:
    """Render as `kernel.render` does, with the geometric normal of each pixel.

    A normal is the normalised cross product of two edges in the camera frame, in float64: under
    scale, shear and mirroring it is what the inverse transpose of cam_from_mesh makes of the
    mesh's normal. Raises as `kernel.render` does.
    """
    normal_cam = np.empty((size_wh[1], size_wh[0], 3), np.float32)
    hits = HitsStruct(normal=normal_cam.ctypes.data)
    buffers = render_into(hits, surfaces, projection, size_wh, depth_scale, threads)
    shown = int(np.count_nonzero(buffers.instance >= 0))
    return Normals(
        buffers=buffers,
        normal_cam=normal_cam,
        flipped_share=hits.flipped / shown if shown else float("nan"),
    )
