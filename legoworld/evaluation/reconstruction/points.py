"""The scoring raster: which pixels are points, where they lie, and how far off they may be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility.scoring_raster import on_raster, picture_projection

Depth = NDArray[np.float32]
Labels = NDArray[np.int32]
Flags = NDArray[np.bool_]
F64 = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Raster:
    """One pixel grid for both surfaces: pixel (r, c) is sampled at (c + 0.5, r + 0.5).

    fx, fy, cx, cy: pixels of this grid.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int


def picture_raster(size_wh: tuple[int, int], hfov_deg: float, raster_wh: tuple[int, int]) -> Raster:
    """The raster of a whole picture, which has square pixels and its principal point in the middle.

    size_wh: the picture's; hfov_deg: its horizontal field of view.
    """
    whole = picture_projection(size_wh, hfov_deg, z_near=0.0, z_far=math.inf)
    part = on_raster(whole, size_wh, raster_wh)
    width, height = raster_wh
    return Raster(fx=part.fx, fy=part.fy, cx=part.cx, cy=part.cy, width=width, height=height)


def finite_points(depth_z_m: NDArray[Any], limit_m: float = math.inf) -> Flags:
    """Where a depth, of any shape, is a point: finite, above 0 and below the limit."""
    with np.errstate(invalid="ignore"):
        finite: Flags = np.isfinite(depth_z_m) & (depth_z_m > 0) & (depth_z_m < limit_m)
    return finite


def points_m(depth_z_m: Depth, raster: Raster) -> F64:
    """(H, W, 3) camera-frame points x right, y down, z forward; not finite where depth is not."""
    z = depth_z_m.astype(np.float64)
    columns = (np.arange(raster.width) + 0.5 - raster.cx) / raster.fx
    rows = (np.arange(raster.height) + 0.5 - raster.cy) / raster.fy
    points = np.empty((raster.height, raster.width, 3))
    with np.errstate(invalid="ignore"):
        np.multiply(columns, z, out=points[..., 0])
        np.multiply(rows[:, None], z, out=points[..., 1])
    points[..., 2] = z
    return points


def point_pixels(points_m: F64, raster: Raster) -> NDArray[np.int64]:
    """(N,) row * width + column of the pixel that contains each point, -1 outside the picture.

    points_m: (N, 3), z above 0 or anywhere: what is behind the camera is outside.
    """
    x, y, z = points_m.T
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        columns = np.floor(raster.cx + raster.fx * x / z)
        rows = np.floor(raster.cy + raster.fy * y / z)
    inside = (z > 0) & (columns >= 0) & (columns < raster.width)
    inside &= (rows >= 0) & (rows < raster.height)
    pixels = np.full(len(points_m), -1, np.int64)
    pixels[inside] = (rows[inside] * raster.width + columns[inside]).astype(np.int64)
    return pixels


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """tau(g) of a reference point g at planar depth z: relative * z + absolute_m."""

    name: str
    relative: float = 0.0
    absolute_m: float = 0.0

    def tau_m(self, z_m: F64) -> F64:
        """The tolerance at reference points of these depths, in their shape."""
        return self.relative * z_m + self.absolute_m


def hit_share(hits: Flags, where: Flags) -> float | None:
    """Share of the (H, W) pixels of `where` that hit; None without any."""
    n = int(np.count_nonzero(where))
    return int(np.count_nonzero(hits & where)) / n if n else None
