"""Views of buffers that are made up, with nothing behind them."""

from __future__ import annotations

import numpy as np
from readouts.quads import SQUARE, at, quads

from legoworld.visibility.kernel import Buffers, Surfaces
from legoworld.visibility.projection import Projection
from legoworld.visibility.runs import instance_extents
from legoworld.visibility.view import View

#: A view of made-up buffers has no surfaces behind it.
NOTHING = Surfaces(
    vertices=np.empty((0, 3), np.float32),
    triangles=np.empty((0, 3), np.int32),
    vertex_start=np.zeros(1, np.int64),
    triangle_start=np.zeros(1, np.int64),
    placement_mesh=np.empty(0, np.int32),
    cam_from_mesh=np.empty((0, 3, 4)),
    placement_id=np.empty(0, np.int32),
    cutouts=None,
)


def view_of(instance: np.ndarray, n: int) -> View:
    height, width = instance.shape
    area, extents = instance_extents(instance, n)
    return View(
        snapshot=quads(("square", SQUARE, at(0, 0, 0))),
        size_wh=(width, height),
        projection=Projection(orthographic=False, fx=1, fy=1, cx=0, cy=0, z_near=0.1, z_far=100),
        surfaces=NOTHING,
        depth_scale=1.0,
        buffers=Buffers(
            instance=instance, depth_z_m=np.where(instance < 0, np.inf, 1).astype(np.float32)
        ),
        area_px=area,
        bbox_xyxy_px=extents,
    )
