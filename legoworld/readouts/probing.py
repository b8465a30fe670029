"""A scene as a private probe looks at it: reference and submission through one function.

And points spread evenly over whatever surface lies in a box of the camera frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.readouts.surface import nearest_clip
from legoworld.records.track import Probe, SecondView
from legoworld.scene.affine import cam_from_mesh, cross, length, transform_points
from legoworld.scene.requests import StandRequest
from legoworld.scene.snapshot import SceneCamera, Snapshot
from legoworld.visibility.projection import Projection
from legoworld.visibility.scoring_raster import on_raster, picture_projection, raster_size

F64 = NDArray[np.float64]
#: Points of one box, whatever its surface: more area is sampled more thinly.
MOST_POINTS: Final = 4096
FEWEST_POINTS: Final = 256
#: Steps of the additive recurrence that spreads points over triangles (Roberts 2018).
_R2: Final = (0.7548776662466927, 0.5698402909980532)
#: The two looks of a probe, as its arrays are called.
OFFSET, VIEW = "offset", "view"


@dataclass(frozen=True, kw_only=True)
class Box:
    """Corners in the camera frame, metres; spacing_m: of the points that are wanted in it."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    spacing_m: float


def box_samples(
    snapshot: Snapshot, boxes: Sequence[Box], *, among: NDArray[np.bool_] | None = None
) -> list[NDArray[np.float32]]:
    """(N, 3) points in the snapshot's camera frame, metres, for each box; the same every time.

    among: (S,) the snapshot's surfaces that count, None for all. Every surface counts, seen or not.
    """
    pieces: list[list[F64]] = [[] for _ in boxes]
    if not boxes:
        return []
    scale = snapshot.render.unit_scale
    low, high = np.array([b.low for b in boxes]), np.array([b.high for b in boxes])
    placed = cam_from_mesh(snapshot.camera, snapshot.world_from_mesh) * scale
    limits = _mesh_limits(snapshot)
    for surface, mesh in enumerate(snapshot.surface_mesh.tolist()):
        if among is not None and not among[surface]:
            continue
        bottom, top = _moved_limits(placed[surface], *limits[mesh])
        near = np.flatnonzero((bottom <= high).all(axis=1) & (top >= low).all(axis=1))
        if not len(near):
            continue
        triangles = mesh_triangles(snapshot, mesh, placed[surface])
        least, most = triangles.min(axis=1), triangles.max(axis=1)
        for k in near.tolist():
            meets = (least <= high[k]).all(axis=1) & (most >= low[k]).all(axis=1)
            within = (least >= low[k]).all(axis=1) & (most <= high[k]).all(axis=1)
            pieces[k].append(triangles[within])
            if (meets & ~within).any():
                pieces[k].append(_clip(triangles[meets & ~within], low[k], high[k]))
    return [
        _spread_points(np.concatenate(parts) if parts else np.zeros((0, 3, 3)), box.spacing_m)
        for parts, box in zip(pieces, boxes, strict=True)
    ]


def mesh_triangles(snapshot: Snapshot, mesh: int, placed: F64) -> F64:
    """(T, 3, 3) corners of a mesh after a (3, 4) transform."""
    begin, end = snapshot.vertex_start[mesh], snapshot.vertex_start[mesh + 1]
    first, last = snapshot.triangle_start[mesh], snapshot.triangle_start[mesh + 1]
    points = transform_points(placed, snapshot.vertices[begin:end].astype(np.float64))
    return np.asarray(points[snapshot.triangles[first:last]], np.float64)


def _mesh_limits(snapshot: Snapshot) -> list[tuple[F64, F64]]:
    """Each mesh's own box; an empty one where it has no vertex."""
    starts = snapshot.vertex_start
    found = []
    for begin, end in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
        points = snapshot.vertices[begin:end].astype(np.float64)
        if len(points):
            found.append((points.min(axis=0), points.max(axis=0)))
        else:
            found.append((np.full(3, np.inf), np.full(3, -np.inf)))
    return found


def _moved_limits(placed: F64, low: F64, high: F64) -> tuple[F64, F64]:
    """The box around a box after a transform."""
    if not (low <= high).all():
        return low, high
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    moved = transform_points(placed, corners)
    return moved.min(axis=0), moved.max(axis=0)


def _clip(triangles: F64, low: F64, high: F64) -> F64:
    """The parts of (N, 3, 3) triangles in a box, as triangles (Sutherland and Hodgman 1974)."""
    polygons, sizes = triangles, np.full(len(triangles), 3)
    for axis in range(3):
        for sign, limit in ((1.0, low[axis]), (-1.0, -high[axis])):
            polygons, sizes = _cut(polygons, sizes, sign * polygons[..., axis] - limit)
            kept = sizes >= 3
            polygons, sizes = polygons[kept], sizes[kept]
    fans = [
        np.stack([polygons[:, 0], polygons[:, k], polygons[:, k + 1]], axis=1)[sizes > k + 1]
        for k in range(1, polygons.shape[1] - 1)
    ]
    return np.concatenate(fans) if fans else np.zeros((0, 3, 3))


def _cut(polygons: F64, sizes: NDArray[np.intp], inside: F64) -> tuple[F64, NDArray[np.intp]]:
    """What is left of (N, K, 3) polygons of so many corners where `inside` is not negative."""
    count, most = polygons.shape[:2]
    places = np.arange(most)
    real = places < sizes[:, None]
    after = np.where(places + 1 < sizes[:, None], places + 1, 0)
    rows = np.arange(count)[:, None]
    here, there = inside, inside[rows, after]
    crosses = real & ((here >= 0) != (there >= 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(crosses, here / (here - there), 0.0)[..., None]
    crossing = polygons + share * (polygons[rows, after] - polygons)
    corners = np.stack([polygons, crossing], axis=2).reshape(count, 2 * most, 3)
    kept = np.stack([real & (here >= 0), crosses], axis=2).reshape(count, 2 * most)
    order = np.argsort(~kept, axis=1, kind="stable")
    left = kept.sum(axis=1)
    return corners[rows, order][:, : max(3, int(left.max(initial=0)))], left


def _spread_points(triangles: F64, spacing_m: float) -> NDArray[np.float32]:
    """Points at equal steps of area through the triangles, spread inside each of them."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area = np.cumsum(length(cross(b - a, c - a))) / 2
    if not len(area) or not area[-1] > 0:
        return triangles[:, 0].astype(np.float32)[:FEWEST_POINTS]
    wanted = min(MOST_POINTS, max(FEWEST_POINTS, round(float(area[-1]) / spacing_m**2)))
    steps = (np.arange(wanted) + 0.5) * (area[-1] / wanted)
    at = np.minimum(np.searchsorted(area, steps), len(area) - 1)
    u, v = (((np.arange(wanted) + 1) * step % 1.0)[:, None] for step in _R2)
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    return np.asarray(a[at] + u * (b - a)[at] + v * (c - a)[at], np.float32)


@dataclass(frozen=True, kw_only=True)
class Look:
    """A snapshot, its camera where the look is from, and the projection in raster pixels."""

    name: str
    snapshot: Snapshot
    projection: Projection


def looks(
    snapshot: Snapshot, size_wh: tuple[int, int], hfov_deg: float, probe: Probe
) -> Iterator[Look]:
    """The raster moved by the offset; then the second view, where there is one."""
    dx, dy = probe.offset_px
    seen = _raster(snapshot.camera, size_wh, hfov_deg)
    yield Look(
        name=OFFSET,
        snapshot=snapshot,
        projection=replace(seen, cx=seen.cx - dx, cy=seen.cy - dy),
    )
    if probe.view is not None:
        stood = replace(
            snapshot.camera,
            world_from_camera=second_pose(snapshot.camera, probe.view, snapshot.render.unit_scale),
        )
        yield Look(
            name=VIEW,
            snapshot=replace(snapshot, camera=stood),
            projection=_raster(stood, size_wh, probe.view.hfov_deg),
        )


def second_pose(
    camera: SceneCamera, view: SecondView, unit_scale: float
) -> tuple[tuple[float, float, float, float], ...]:
    """(3, 4) world_from_camera of the second view, from the first camera's pose; scene units."""
    rotation = np.array(camera.world_from_camera, np.float64)
    moved = np.array(view.cam_from_view, np.float64)
    moved[:3, 3] /= unit_scale
    rows = [
        [sum(row[k] * moved[k, c] for k in range(3)) + row[3] * moved[3, c] for c in range(4)]
        for row in rotation.tolist()
    ]
    return tuple((float(a), float(b), float(c), float(d)) for a, b, c, d in rows)


def second_stand(snapshot: Snapshot, view: SecondView, hfov_deg: float) -> StandRequest:
    """The second camera as Blender is given it. hfov_deg: of the case's first view.

    A submission of another field of view than the first one keeps the difference.
    """
    first, second = (math.tan(math.radians(angle) / 2) for angle in (hfov_deg, view.hfov_deg))
    pose = second_pose(snapshot.camera, view, snapshot.render.unit_scale)
    return {"world_from_camera": pose, "zoom": first / second}


def probe_boxes(probe: Probe) -> list[Box]:
    """The boxes whose surface is sampled."""
    return [
        Box(low=low, high=high, spacing_m=spacing)
        for (low, high), spacing in zip(probe.boxes_m, probe.spacings_m, strict=True)
    ]


def surface_disagreement(
    kernel_z: NDArray[np.float32],
    cycles_z: NDArray[np.float32],
    kernel_object: NDArray[np.int64],
    cycles_object: NDArray[np.int32],
    relative: float,
) -> float | None:
    """Share of pixels where Cycles meets another surface than the kernel; None without any.

    A sample of Cycles lies anywhere in its pixel's filter: it agrees with any depth between the
    nearest and the farthest of the kernel's 3 x 3 pixels around, give or take `relative`, and with
    any object that one of them shows. Arrays: (H, W), of depths in metres and of ids.
    """
    either = np.isfinite(kernel_z) | np.isfinite(cycles_z)
    if not either.any():
        return None
    around, objects = (
        np.lib.stride_tricks.sliding_window_view(np.pad(values, 1, mode="edge"), (3, 3))
        for values in (kernel_z, kernel_object)
    )
    low, high = around.min(axis=(2, 3)), around.max(axis=(2, 3))
    agrees = (cycles_z >= low * (1 - relative)) & (cycles_z <= high * (1 + relative))
    same = (objects == cycles_object[..., None, None]).any(axis=(2, 3))
    agrees &= same | ~np.isfinite(cycles_z)
    return float(np.count_nonzero(either & ~agrees)) / int(np.count_nonzero(either))


def _raster(camera: SceneCamera, size_wh: tuple[int, int], hfov_deg: float) -> Projection:
    pinhole = picture_projection(
        size_wh, hfov_deg, z_near=nearest_clip(camera), z_far=camera.clip_end
    )
    return on_raster(pinhole, size_wh, raster_size(size_wh))
