"""The kernel's input as plain arrays, and their checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from legoworld.errors import ShapeError

#: Placement id of a holdout: it occludes what is behind it and is erased itself.
HOLDOUT = -2

WRAPS = ("repeat", "extend", "clip", "mirror")
INTERPOLATIONS = ("closest", "linear")
SIDES = ("both", "front", "back")

#: Above this a product of three coordinates could overflow.
LARGEST_ENTRY = 1e30

_LARGEST_INT32: Final = 2**31 - 1


@dataclass(frozen=True, kw_only=True)
class Cutouts:
    """Alpha on some triangles: samples below the threshold are dropped.

    Alpha is the image's (its texel / 255) times what the corners hold, where there is corner_alpha.

    triangle_cutout: (T,) int32, -1 = opaque, else an index into `alphas`; corner_uv: (T, 3, 2)
    float32, v upwards; alphas: (H, W) uint8 each, row 0 = top row of the image; texel (row, column)
    has its centre at u = (column + 0.5) / W, v = 1 - (row + 0.5) / H. wrap, interpolation and
    sides: one per alpha. Under "clip", alpha is 0 outside 0..1, also for linear interpolation.

    corner_alpha: (T, 3) float32 or None, interpolated as the corners' texture coordinates are.
    sides: "front" is the side from which a mesh's corners run anticlockwise, in its own frame: a
    mirrored placement does not turn it. A triangle is not there from any other side than its own.
    """

    triangle_cutout: NDArray[np.int32]
    corner_uv: NDArray[np.float32]
    alphas: tuple[NDArray[np.uint8], ...]
    wrap: tuple[Literal["repeat", "extend", "clip", "mirror"], ...]
    interpolation: tuple[Literal["closest", "linear"], ...]
    sides: tuple[Literal["both", "front", "back"], ...]
    corner_alpha: NDArray[np.float32] | None = None
    threshold: float


@dataclass(frozen=True, kw_only=True)
class Surfaces:
    """Triangle meshes and where they are placed. Arrays are C-contiguous.

    vertices: (V, 3) float32, all meshes one after another, each in its mesh's frame; triangles:
    (T, 3) int32, indices local to the mesh; vertex_start, triangle_start: (M + 1,) int64, mesh m
    owns [start[m], start[m + 1]). placement_mesh: (P,) int32; cam_from_mesh: (P, 3, 4) float64;
    placement_id: (P,) int32, an instance id >= 0 (several placements may share one) or HOLDOUT.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    vertex_start: NDArray[np.int64]
    triangle_start: NDArray[np.int64]
    placement_mesh: NDArray[np.int32]
    cam_from_mesh: NDArray[np.float64]
    placement_id: NDArray[np.int32]
    cutouts: Cutouts | None


@dataclass(frozen=True, kw_only=True)
class Buffers:
    """The surface hit at each pixel centre.

    instance: (H, W) int32, -1 = nothing; depth_z_m: (H, W) float32 planar z in metres, +inf =
    nothing.
    """

    instance: NDArray[np.int32]
    depth_z_m: NDArray[np.float32]


def check_surfaces(surfaces: Surfaces) -> None:
    """Raises ShapeError unless every array has its type, shape and range.

    The kernel checks the large arrays while it draws: finite vertices, and triangle indices
    within their mesh.
    """
    vertices = _array("vertices", surfaces.vertices, np.float32, (None, 3))
    triangles = _array("triangles", surfaces.triangles, np.int32, (None, 3))
    meshes = max(len(surfaces.vertex_start) - 1, 0)
    _starts("vertex_start", surfaces.vertex_start, meshes, len(vertices))
    _starts("triangle_start", surfaces.triangle_start, meshes, len(triangles))
    mesh = _array("placement_mesh", surfaces.placement_mesh, np.int32, (None,))
    placements = len(mesh)
    matrix = _array("cam_from_mesh", surfaces.cam_from_mesh, np.float64, (placements, 3, 4))
    ident = _array("placement_id", surfaces.placement_id, np.int32, (placements,))
    _range("placement_mesh", mesh, 0, meshes - 1)
    if not np.all(np.abs(matrix) <= LARGEST_ENTRY):
        raise ShapeError(
            "cam_from_mesh holds a number the kernel cannot work with",
            found="NaN, infinite, or larger than 1e30",
            next_step="check the object and camera transforms of the scene",
        )
    if np.any((ident < 0) & (ident != HOLDOUT)):
        raise ShapeError(
            "placement_id is out of range",
            found=str(int(ident[(ident < 0) & (ident != HOLDOUT)][0])),
            expected=f"an instance id >= 0, or {HOLDOUT} for a holdout",
        )
    if np.any(ident == _LARGEST_INT32):
        raise ShapeError(
            "placement_id is out of range", found="2147483647", expected="a smaller id"
        )
    if surfaces.cutouts is not None:
        _check_cutouts(surfaces.cutouts, len(triangles))


def check_corner_normals(corner_normals: NDArray[np.float32], surfaces: Surfaces) -> None:
    """ShapeError unless there is a normal for each corner of each triangle, (T, 3, 3)."""
    _array("corner_normals", corner_normals, np.float32, (len(surfaces.triangles), 3, 3))


def _check_cutouts(cutouts: Cutouts, triangles: int) -> None:
    index = _array("triangle_cutout", cutouts.triangle_cutout, np.int32, (triangles,))
    uv = _array("corner_uv", cutouts.corner_uv, np.float32, (triangles, 3, 2))
    _range("triangle_cutout", index, -1, len(cutouts.alphas) - 1)
    if not np.all(np.isfinite(uv)):
        raise ShapeError("corner_uv holds a NaN or an infinite number")
    if cutouts.corner_alpha is not None:
        values = _array("corner_alpha", cutouts.corner_alpha, np.float32, (triangles, 3))
        if not np.all(np.isfinite(values)):
            raise ShapeError("corner_alpha holds a NaN or an infinite number")
    if not np.isfinite(cutouts.threshold):
        raise ShapeError("the alpha threshold is not finite", found=str(cutouts.threshold))
    for name, given, known in (
        ("wrap", cutouts.wrap, WRAPS),
        ("interpolation", cutouts.interpolation, INTERPOLATIONS),
        ("sides", cutouts.sides, SIDES),
    ):
        if len(given) != len(cutouts.alphas):
            raise ShapeError(
                f"{name} has one entry per alpha image",
                found=str(len(given)),
                expected=str(len(cutouts.alphas)),
            )
        for value in given:
            if value not in known:
                raise ShapeError(f"{name} is unknown", found=value, expected=", ".join(known))
    for i, alpha in enumerate(cutouts.alphas):
        _array(f"alphas[{i}]", alpha, np.uint8, (None, None))
        if alpha.size == 0:
            raise ShapeError(f"alphas[{i}] is empty", found=str(alpha.shape))


def _array(
    name: str, array: ArrayLike, dtype: DTypeLike, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    if not isinstance(array, np.ndarray):
        raise ShapeError(
            f"{name} is not an array",
            found=type(array).__name__,
            expected=_describe_array(dtype, shape),
        )
    fits = array.ndim == len(shape) and all(
        n is None or n == actual for n, actual in zip(shape, array.shape, strict=True)
    )
    if array.dtype != dtype or not fits:
        raise ShapeError(
            f"{name} has the wrong type or shape",
            found=f"{array.dtype.name} of shape {array.shape}",
            expected=_describe_array(dtype, shape),
        )
    if not array.flags.c_contiguous:
        raise ShapeError(f"{name} is not C-contiguous", next_step="pass np.ascontiguousarray(...)")
    return array


def _describe_array(dtype: DTypeLike, shape: tuple[int | None, ...]) -> str:
    sides = ", ".join("any" if n is None else str(n) for n in shape)
    return f"{np.dtype(dtype).name} of shape ({sides})"


def _starts(name: str, starts: ArrayLike, meshes: int, total: int) -> None:
    array = _array(name, starts, np.int64, (meshes + 1,))
    sizes = array[1:] - array[:-1]
    if array[0] != 0 or array[-1] != total or (sizes < 0).any():
        raise ShapeError(
            f"{name} does not divide its array among the meshes",
            found=f"{array[0]} to {array[-1]}",
            expected=f"0 to {total}, non-decreasing",
        )
    if meshes and sizes.max() > _LARGEST_INT32:
        raise ShapeError(f"a mesh is too large for int32 indices, by {name}")


def _range(name: str, array: NDArray[np.int32], low: int, high: int) -> None:
    if array.size and (array.min() < low or array.max() > high):
        raise ShapeError(
            f"{name} is out of range",
            found=f"[{array.min()}, {array.max()}]",
            expected=f"[{low}, {high}]",
        )
