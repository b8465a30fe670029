"""A brute-force renderer to judge the kernel by: every ray, every triangle, in long double.

It shares no formula with the kernel: Moeller and Trumbore's ray-triangle test ("Fast, minimum
storage ray-triangle intersection", 1997), barycentric alpha look-up, and a plain minimum over all
hits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from visibility.kernel_hits import Hits

from legoworld.visibility.kernel import HOLDOUT, Cutouts, Surfaces
from legoworld.visibility.projection import Projection

Real = np.longdouble
Rays = tuple[NDArray[np.longdouble], NDArray[np.longdouble]]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What each ray hits, and where rounding decides.

    instance: (H, W) int32; depth_z_m: (H, W) longdouble; doubtful: (H, W) bool, the ray passes
    within rounding of an edge or of two surfaces at one depth. placement, triangle (local to its
    mesh): (H, W) int32, of the nearest hit, -1 without one; weights: (H, W, 3) longdouble.
    """

    instance: NDArray[np.int32]
    depth_z_m: NDArray[np.longdouble]
    doubtful: NDArray[np.bool_]
    placement: NDArray[np.int32]
    triangle: NDArray[np.int32]
    weights: NDArray[np.longdouble]


def camera_triangles(surfaces: Surfaces, placement: int) -> NDArray[np.longdouble]:
    """(T, 3, 3) corners of a placement's triangles in the camera's frame."""
    mesh = surfaces.placement_mesh[placement]
    v0, v1 = surfaces.vertex_start[mesh : mesh + 2]
    t0, t1 = surfaces.triangle_start[mesh : mesh + 2]
    matrix = surfaces.cam_from_mesh[placement].astype(Real)
    points = surfaces.vertices[v0:v1].astype(Real) @ matrix[:, :3].T + matrix[:, 3]
    return points[surfaces.triangles[t0:t1]]


def rays(
    projection: Projection, size_wh: tuple[int, int]
) -> tuple[NDArray[np.longdouble], NDArray[np.longdouble]]:
    """Origins and directions, (H, W, 3) each; a direction has z = 1: its length unit is depth."""
    width, height = size_wh
    x = (np.arange(width, dtype=Real) + Real(0.5) - Real(projection.cx)) / Real(projection.fx)
    y = (np.arange(height, dtype=Real) + Real(0.5) - Real(projection.cy)) / Real(projection.fy)
    across = np.stack([*np.meshgrid(x, y), np.zeros((height, width), Real)], axis=-1)
    forward = np.broadcast_to(np.array([0, 0, 1], Real), across.shape)
    if projection.orthographic:
        return across, forward
    return np.zeros_like(across), across + forward


def intersect(
    corners: NDArray[np.longdouble],
    origins: NDArray[np.longdouble],
    directions: NDArray[np.longdouble],
) -> tuple[NDArray[np.longdouble], NDArray[np.longdouble]]:
    """Barycentric weights (..., 3) and depth (...) where each ray meets the triangle's plane."""
    edge1, edge2 = corners[1] - corners[0], corners[2] - corners[0]
    across = np.cross(directions, edge2)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = Real(1) / (across @ edge1)
        offset = origins - corners[0]
        b1 = np.sum(offset * across, axis=-1) * inverse
        turned = np.cross(offset, edge1)
        b2 = np.sum(directions * turned, axis=-1) * inverse
        depth = (turned @ edge2) * inverse
        b0 = 1 - b1 - b2
    return np.stack([b0, b1, b2], axis=-1), depth


def _wrapped(index: NDArray[np.int64], size: int, wrap: str) -> NDArray[np.int64]:
    if wrap == "repeat":
        return index % size
    if wrap == "extend":
        return np.clip(index, 0, size - 1)
    if wrap == "mirror":
        turn = index % (2 * size)
        return np.where(turn < size, turn, 2 * size - 1 - turn)
    return np.where((index >= 0) & (index < size), index, -1)


def sample_alpha(
    alpha: NDArray[np.uint8], uv: NDArray[np.longdouble], wrap: str, interpolation: str
) -> NDArray[np.longdouble]:
    """Alpha in 0..1 at (..., 2) uv: texel centres at (i + 0.5) / N, v upwards."""
    height, width = alpha.shape
    rows_up = alpha[::-1].astype(Real) / 255

    def at(columns: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.longdouble]:
        c, r = _wrapped(columns, width, wrap), _wrapped(rows, height, wrap)
        return np.where((c >= 0) & (r >= 0), rows_up[r, c], Real(0))

    place = uv * np.array([width, height], Real) - (Real(0.5) if interpolation == "linear" else 0)
    low = np.floor(place)
    column, row = low[..., 0].astype(np.int64), low[..., 1].astype(np.int64)
    if interpolation == "linear":
        tx, ty = place[..., 0] - low[..., 0], place[..., 1] - low[..., 1]
        value = (1 - ty) * ((1 - tx) * at(column, row) + tx * at(column + 1, row)) + ty * (
            (1 - tx) * at(column, row + 1) + tx * at(column + 1, row + 1)
        )
    else:
        value = at(column, row)
    outside = np.any((uv < 0) | (uv > 1), axis=-1)
    return np.where(outside, Real(0), value) if wrap == "clip" else value


def _there(
    cutouts: Cutouts | None, triangle: int, weights: NDArray[np.longdouble]
) -> NDArray[np.bool_]:
    index = -1 if cutouts is None else int(cutouts.triangle_cutout[triangle])
    if cutouts is None or index < 0:
        return np.ones(weights.shape[:-1], bool)
    uv = np.nan_to_num(weights) @ cutouts.corner_uv[triangle].astype(Real)
    alpha = sample_alpha(
        cutouts.alphas[index], uv, cutouts.wrap[index], cutouts.interpolation[index]
    )
    if cutouts.corner_alpha is not None:
        alpha = alpha * (np.nan_to_num(weights) @ cutouts.corner_alpha[triangle].astype(Real))
    return alpha >= cutouts.threshold


def _faces(
    surfaces: Surfaces, placement: int, triangle: int, local: int, rays: Rays
) -> NDArray[np.bool_]:
    """Which rays meet a triangle from a side it is seen from, found in the mesh's own frame."""
    cutouts = surfaces.cutouts
    index = -1 if cutouts is None else int(cutouts.triangle_cutout[triangle])
    if cutouts is None or index < 0 or cutouts.sides[index] == "both":
        return np.ones(rays[0].shape[:-1], bool)
    mesh = surfaces.placement_mesh[placement]
    begin, end = surfaces.vertex_start[mesh : mesh + 2]
    start = surfaces.triangle_start[mesh]
    a, b, c = surfaces.vertices[begin:end].astype(Real)[surfaces.triangles[start + local]]
    inverse = np.linalg.inv(surfaces.cam_from_mesh[placement][:, :3]).astype(Real)
    front = (rays[1] @ inverse.T) @ np.cross(b - a, c - a) < 0
    return front if cutouts.sides[index] == "front" else ~front


def render(
    surfaces: Surfaces,
    projection: Projection,
    size_wh: tuple[int, int],
    *,
    depth_scale: float = 1.0,
    edge_tolerance: float = 1e-9,
    depth_tolerance: float = 2e-7,
) -> Truth:
    """Every ray against every triangle. Tolerances say what counts as doubtful, not what is hit."""
    origins, directions = rays(projection, size_wh)
    width, height = size_wh
    best = np.full((height, width), np.inf, Real)
    best_id = np.full((height, width), np.iinfo(np.int32).max, np.int32)
    source = np.full((height, width, 2), -1, np.int32)
    best_weights = np.full((height, width, 3), np.nan, Real)
    second = np.full((height, width), np.inf, Real)  # nearest depth of another id
    grazed = np.full((height, width), np.inf, Real)  # nearest depth of a doubtful hit
    for placement, ident in enumerate(surfaces.placement_id):
        first = surfaces.triangle_start[surfaces.placement_mesh[placement]]
        for local, corners in enumerate(camera_triangles(surfaces, placement)):
            weights, depth = intersect(corners, origins, directions)
            least = weights.min(axis=-1)
            in_range = (depth >= projection.z_near) & (depth <= projection.z_far)
            number = int(first) + local
            valid = in_range & _there(surfaces.cutouts, number, weights)
            valid &= _faces(surfaces, placement, number, local, (origins, directions))
            edge = in_range & (np.abs(least) <= edge_tolerance)
            grazed = np.where(edge, np.minimum(grazed, depth), grazed)
            hit = valid & (least >= 0)
            nearer = hit & ((depth < best) | ((depth == best) & (ident < best_id)))
            other = ident != best_id
            second = np.where(nearer & other, best, second)
            second = np.where(hit & ~nearer & other, np.minimum(second, depth), second)
            best = np.where(nearer, depth, best)
            source[nearer] = placement, local
            best_weights[nearer] = weights[nearer]
            best_id = np.where(nearer, ident, best_id).astype(np.int32)
    reach = np.where(np.isfinite(best), best + depth_tolerance * np.abs(best), np.inf)
    doubtful = np.isfinite(second) & (second <= reach)
    doubtful |= np.isfinite(grazed) & (grazed <= reach)
    shown = np.isfinite(best) & (best_id != HOLDOUT)
    return Truth(
        instance=np.where(shown, best_id, -1).astype(np.int32),
        depth_z_m=np.where(shown, best * Real(depth_scale), np.inf),
        doubtful=doubtful,
        placement=np.where(shown, source[..., 0], -1),
        triangle=np.where(shown, source[..., 1], -1),
        weights=np.where(shown[..., None], best_weights, np.nan),
    )


def corners_of(hits: Hits, surfaces: Surfaces, shown: NDArray[np.bool_]) -> NDArray[np.longdouble]:
    """(N, 3, 3) corners in the camera's frame of the triangles that some pixels show."""
    own = [camera_triangles(surfaces, i) for i in range(len(surfaces.placement_mesh))]
    first = np.concatenate([[0], np.cumsum([len(one) for one in own])[:-1]])
    return np.concatenate(own)[first[hits.placement[shown]] + hits.triangle[shown]]
