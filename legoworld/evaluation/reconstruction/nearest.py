"""Exact nearest neighbours between two visible surfaces on one pixel grid: nearest.cpp."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.kernels.library import check, library, pointer
from legoworld.evaluation.reconstruction.points import Depth, Labels, Raster


class _GridStruct(ctypes.Structure):
    """LwGrid of nearest_cloud.hpp."""

    _fields_: ClassVar = [
        ("fx", ctypes.c_double),
        ("fy", ctypes.c_double),
        ("cx", ctypes.c_double),
        ("cy", ctypes.c_double),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("labels", ctypes.c_int32),
    ]


@dataclass(frozen=True, kw_only=True)
class Nearest:
    """Each point's nearest point of the other surface, within its label.

    squared_m2: (H, W) float64 squared Euclidean distance, +inf where there is no point or the other
    surface has none of the label; index: (H, W) int32 row * W + column of the nearest, the lowest
    of those at equal distance; -1 where there is none.
    """

    squared_m2: NDArray[np.float64]
    index: NDArray[np.int32]


def nearest_both_ways(
    a_depth_z_m: Depth, b_depth_z_m: Depth, label: Labels, raster: Raster, *, plain: bool = False
) -> tuple[Nearest, Nearest]:
    """Of each point of a its nearest of b, and of each point of b its nearest of a.

    a_depth_z_m, b_depth_z_m: (H, W) float32, a point where finite and positive; label: (H, W) int32
    from 0, -1 takes no part. The answer is that of every pair in float64, bit for bit.
    plain: without AVX2, for tests: the same answer.
    """
    shape = raster.height, raster.width
    assert a_depth_z_m.shape == b_depth_z_m.shape == label.shape == shape
    depths = [np.ascontiguousarray(d, np.float32) for d in (a_depth_z_m, b_depth_z_m)]
    labels = np.ascontiguousarray(label, np.int32)
    grid = _GridStruct(
        raster.fx, raster.fy, raster.cx, raster.cy, raster.width, raster.height,
        max(int(labels.max(initial=-1)) + 1, 1),
    )  # fmt: skip
    found = [
        Nearest(squared_m2=np.full(shape, np.inf), index=np.full(shape, -1, np.int32))
        for _ in range(2)
    ]
    a, b = found
    done = library().lw_nearest(
        ctypes.byref(grid), pointer(labels), pointer(depths[0]), pointer(depths[1]),
        ctypes.c_int32(plain), pointer(a.squared_m2), pointer(a.index), pointer(b.squared_m2),
        pointer(b.index),
    )  # fmt: skip
    check(done)
    return a, b
