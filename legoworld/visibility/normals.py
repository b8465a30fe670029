"""Normals of the surface that each pixel shows: of its triangle's plane, or as it is shaded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility.kernel import render_into
from legoworld.visibility.library import HitsStruct
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import Buffers, Surfaces, check_corner_normals

#: "geometric": of the triangle's plane; "shading": interpolated between its corners' normals.
Variant = Literal["geometric", "shading"]


@dataclass(frozen=True, kw_only=True)
class Normals:
    """A normal per pixel, and the buffers of the same drawing.

    normal_cam: (H, W, 3) float32, unit vectors in the OpenCV camera frame (x right, y down,
    z forward), NaN where nothing is shown. They point towards the camera: n . ray <= 0 with the
    pixel's own ray, so a frontal wall has (0, 0, -1), and n_z may be positive at wide angles. A
    shading normal is on the same side of its triangle as the geometric one.
    variant: what they are. flipped_share: of the pixels with a normal, the share whose triangle
    shows its back; NaN without any. The front is the side from which the corners run anticlockwise
    in the mesh's own frame: a mirrored placement does not turn it.
    """

    buffers: Buffers
    normal_cam: NDArray[np.float32]
    variant: Variant
    flipped_share: float


def render_normals(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    *,
    corner_normals: NDArray[np.float32] | None = None,
    depth_scale: float = 1.0,
    threads: int | None = None,
) -> Normals:
    """Render as `kernel.render` does, with the normal of each pixel.

    A geometric normal is the normalised cross product of two edges in the camera frame, in float64:
    under scale, shear and mirroring it is what the inverse transpose of cam_from_mesh makes of the
    mesh's normal. corner_normals: (T, 3, 3) float32, in the mesh's frame, of any length, for
    shading normals: moved by the inverse transpose, normalised, interpolated at the pixel centre
    and normalised again. A triangle with a corner of 0 or NaN is flat: its geometric normal.
    Raises as `kernel.render` does.
    """
    normal_cam = np.empty((size_wh[1], size_wh[0], 3), np.float32)
    hits = HitsStruct(normal=normal_cam.ctypes.data)
    if corner_normals is not None:
        check_corner_normals(corner_normals, surfaces)
        hits.corner_normal = corner_normals.ctypes.data
    buffers = render_into(hits, surfaces, projection, size_wh, depth_scale, threads)
    shown = int(np.count_nonzero(buffers.instance >= 0))
    return Normals(
        buffers=buffers,
        normal_cam=normal_cam,
        variant="geometric" if corner_normals is None else "shading",
        flipped_share=hits.flipped / shown if shown else float("nan"),
    )
