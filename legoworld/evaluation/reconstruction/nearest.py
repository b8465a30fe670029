"""Exact nearest neighbours between two visible surfaces on one pixel grid: nearest.cpp."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.kernels.library import call, pointer, pointers
from legoworld.evaluation.reconstruction.points import Depth, Labels, Raster, Tolerance


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


class _SurfaceStruct(ctypes.Structure):
    """LwSurface of nearest_cloud.hpp."""

    _fields_: ClassVar = [
        ("grid", _GridStruct),
        *pointers("depth", "label", "motion"),
    ]


@dataclass(frozen=True, kw_only=True)
class GridSurface:
    """A visible surface on a pixel grid, and where its points go.

    depth_z_m: (H, W) float32, a point where finite and positive; label: (H, W) int32 from 0, -1
    takes no part; motion: (3, 4) float64 rows of a rigid motion of its points, None for none.
    """

    depth_z_m: Depth
    label: Labels
    raster: Raster
    motion: NDArray[np.float64] | None = None


#: As wide a vector as the CPU has.
WIDEST: Final = 8


@dataclass(frozen=True, kw_only=True)
class Nearest:
    """Each point's nearest point of the other surface, within its label.

    squared_m2: (H, W) float64 squared Euclidean distance, +inf where there is no point or the other
    surface has none of the label; index: (H, W) int32 row * W + column of the nearest, the lowest
    of those at equal distance; -1 where there is none. Asked for tolerances, it is a point that
    every one of them takes for what it takes the nearest for: a hit or a miss; none is a miss.
    """

    squared_m2: NDArray[np.float64]
    index: NDArray[np.int32]


def nearest_between(
    a: GridSurface,
    b: GridSurface,
    *,
    tolerances: Sequence[Tolerance] = (),
    lanes: int = WIDEST,
) -> tuple[Nearest, Nearest]:
    """Of each point of a its nearest of b, and of each point of b its nearest of a.

    The grids are of one size. Every answer is that of every pair in float64, bit for bit. With
    tolerances, at the planar depths of a, which has no motion, only their hits are those of every
    pair: nothing is looked for that changes none of them.
    lanes: float64 numbers in a vector at most, for tests: the same answers.
    """
    shape = a.raster.height, a.raster.width
    pair = _Pair(a, b, _labels(a, b), tolerances, lanes)
    nearest = [
        Nearest(squared_m2=np.full(shape, np.inf), index=np.full(shape, -1, np.int32))
        for _ in range(2)
    ]
    first, second = nearest
    answers = first.squared_m2, first.index, second.squared_m2, second.index
    call("lw_nearest", *pair.arguments(), *answers)
    return first, second


@dataclass(frozen=True, kw_only=True)
class Hits:
    """How many points of each label there are, and how many are within each tolerance.

    n_a, n_b: (labels,) int64; a, b: (labels, tolerances) int64. Of a point of a, the tolerance at
    its own planar depth; of a point of b, at that of the point of a nearest to it.
    """

    n_a: NDArray[np.int64]
    n_b: NDArray[np.int64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]


def hits_between(
    a: GridSurface,
    b: GridSurface,
    labels: int,
    tolerances: Sequence[Tolerance],
    *,
    lanes: int = WIDEST,
) -> Hits:
    """The hits of `nearest_between`, counted by label: 0 .. labels - 1."""
    pair = _Pair(a, b, max(labels, _labels(a, b)), tolerances, lanes)
    sizes = np.zeros((pair.labels, 2), np.int64)
    counts = [np.zeros((pair.labels, len(tolerances)), np.int64) for _ in range(2)]
    call("lw_hits", *pair.arguments(), sizes, *counts)
    of_a, of_b = (c[:labels] for c in counts)
    return Hits(n_a=sizes[:labels, 0], n_b=sizes[:labels, 1], a=of_a, b=of_b)


def _labels(a: GridSurface, b: GridSurface) -> int:
    highest = a.label.max(initial=-1)
    return max(int(highest if b.label is a.label else max(highest, b.label.max(initial=-1))) + 1, 1)


class _Pair:
    """The arguments that both functions begin with, and the arrays that they point into."""

    def __init__(
        self,
        a: GridSurface,
        b: GridSurface,
        labels: int,
        tolerances: Sequence[Tolerance],
        lanes: int,
    ) -> None:
        shape = a.raster.height, a.raster.width
        self.labels, self._lanes, self._kept = labels, lanes, list[NDArray[Any]]()
        self._structs = [_struct(one, labels, shape, self._kept) for one in (a, b)]
        self._relative = np.array([t.relative for t in tolerances], np.float64)
        self._absolute = np.array([t.absolute_m for t in tolerances], np.float64)

    def arguments(self) -> tuple[object, ...]:
        n = ctypes.c_int32(len(self._relative))
        return (*self._structs, self._relative, self._absolute, n, ctypes.c_int32(self._lanes))


def share_raster(
    first_z_m: Depth, second_z_m: Depth, label: Labels, raster: Raster
) -> tuple[GridSurface, GridSurface]:
    """Two depths on one raster, whose (H, W) pixels have one label."""
    first, second = (
        GridSurface(depth_z_m=depth, label=label, raster=raster)
        for depth in (first_z_m, second_z_m)
    )
    return first, second


def _struct(
    surface: GridSurface, labels: int, shape: tuple[int, int], kept: list[NDArray[Any]]
) -> _SurfaceStruct:
    """The surface for C++, whose arrays live as long as `kept` does."""
    raster = surface.raster
    assert surface.depth_z_m.shape == surface.label.shape == shape == (raster.height, raster.width)
    grid = _GridStruct(
        raster.fx, raster.fy, raster.cx, raster.cy, raster.width, raster.height, labels
    )
    depth = np.ascontiguousarray(surface.depth_z_m, np.float32)
    label = np.ascontiguousarray(surface.label, np.int32)
    motion = None
    if surface.motion is not None:
        assert surface.motion.shape == (3, 4)
        motion = np.ascontiguousarray(surface.motion, np.float64)
        kept.append(motion)
    kept += [depth, label]
    return _SurfaceStruct(
        grid, pointer(depth), pointer(label), None if motion is None else pointer(motion)
    )
