"""A scene as a private probe looks at it: reference and submission through one function."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from legoworld.readouts.box_samples import Box
from legoworld.readouts.surface import nearest_clip
from legoworld.records.track import Probe, SecondView
from legoworld.scene.requests import StandRequest
from legoworld.scene.snapshot import SceneCamera, Snapshot
from legoworld.visibility.projection import Projection
from legoworld.visibility.scoring_raster import on_raster, picture_projection, raster_size

#: The two looks of a probe, as its arrays are called.
OFFSET, VIEW = "offset", "view"


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
