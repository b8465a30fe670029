"""The pixel grid that LEGO-Bench samples both clouds on."""

from __future__ import annotations

import math
from typing import Final

from legoworld.visibility.projection import Projection

#: Largest number of points of a cloud; stated in readouts/bench.toml.
POINT_CAP: Final = 100_000


def raster_size(size_wh: tuple[int, int]) -> tuple[int, int]:
    """(W, H) of the raster for a picture: at most `POINT_CAP` points in the picture's aspect.

    W = floor(sqrt(POINT_CAP w / h)), H = round(W h / w), halves to the even: 421 x 237 for 16:9.
    Where rounding up would pass the cap, H is one less.
    """
    width, height = size_wh
    columns = max(1, math.isqrt(POINT_CAP * width // height))
    rows = max(1, round(columns * height / width))
    return columns, rows - (columns * rows > POINT_CAP and rows > 1)


def picture_projection(
    size_wh: tuple[int, int], hfov_deg: float, *, z_near: float, z_far: float
) -> Projection:
    """A pinhole over a whole picture: square pixels, its principal point in the middle.

    z_near, z_far: planar z in scene units, as `Projection` has them.
    """
    width, height = size_wh
    focal = width / 2 / math.tan(math.radians(hfov_deg) / 2)
    return Projection(
        orthographic=False,
        fx=focal,
        fy=focal,
        cx=width / 2,
        cy=height / 2,
        z_near=z_near,
        z_far=z_far,
    )


def on_raster(
    projection: Projection, size_wh: tuple[int, int], raster_wh: tuple[int, int]
) -> Projection:
    """A picture's projection in the raster's pixels: the edges of both are the same rays."""
    across, down = raster_wh[0] / size_wh[0], raster_wh[1] / size_wh[1]
    return Projection(
        orthographic=projection.orthographic,
        fx=projection.fx * across,
        fy=projection.fy * down,
        cx=projection.cx * across,
        cy=projection.cy * down,
        z_near=projection.z_near,
        z_far=projection.z_far,
    )
