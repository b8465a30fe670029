"""The visible surface of a submission, on the scoring raster and in the reference's view."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.files import write_npz
from legoworld.records.joints import Pose
from legoworld.records.submission import SubmittedCamera
from legoworld.scene.snapshot import SceneCamera, Snapshot
from legoworld.visibility.camera import projection
from legoworld.visibility.projection import Projection
from legoworld.visibility.scoring_raster import on_raster, picture_projection, raster_size
from legoworld.visibility.view import surfaces_through

#: Focal lengths and principal points that differ by less than this share are the same camera.
_SAME: Final = 1e-9
#: The nearest clip distance, in scene units, of an orthographic camera that is read as a pinhole.
_NEAREST: Final = 1e-6


@dataclass(frozen=True, kw_only=True)
class VisibleSurface:
    """Buffers at the scoring raster, (H, W), from the submission's pose.

    depth_z_m: float32, +inf for no hit; surface_index: int32, of the snapshot's surface, -1 for
    none; both with the reference's intrinsics. own_depth_z_m, own_shown: with the submission's
    own, None where those are equal or it is orthographic. projections: raster pixels.
    """

    raster_wh: tuple[int, int]
    projection: Projection
    depth_z_m: NDArray[np.float32]
    surface_index: NDArray[np.int32]
    own_projection: Projection | None
    own_depth_z_m: NDArray[np.float32] | None
    own_shown: NDArray[np.int32] | None

    @property
    def finite_px(self) -> int:
        """Raster pixels that show geometry."""
        return int(np.isfinite(self.depth_z_m).sum())


def visible_surface(
    snapshot: Snapshot,
    size_wh: tuple[int, int],
    hfov_deg: float,
    *,
    own_intrinsics: bool = True,
    threads: int | None = None,
) -> VisibleSurface:
    """What a snapshot's active camera sees from its pose through the reference's pinhole.

    size_wh, hfov_deg: of the reference's picture. The camera's own clip range applies.
    """
    raster_wh = raster_size(size_wh)
    camera = snapshot.camera
    pinhole = picture_projection(
        size_wh, hfov_deg, z_near=nearest_clip(camera), z_far=camera.clip_end
    )  # fmt: skip
    seen = on_raster(pinhole, size_wh, raster_wh)
    buffers = surfaces_through(seen, snapshot, raster_wh, threads=threads)
    own = projection(camera, snapshot.render, size_wh)
    own_seen, own_buffers = None, None
    if own_intrinsics and camera.type == "PERSP" and not _is_same_projection(own, pinhole):
        own_seen = on_raster(own, size_wh, raster_wh)
        own_buffers = surfaces_through(own_seen, snapshot, raster_wh, threads=threads)
    return VisibleSurface(
        raster_wh=raster_wh,
        projection=seen,
        depth_z_m=buffers.depth_z_m,
        surface_index=buffers.instance,
        own_projection=own_seen,
        own_depth_z_m=own_buffers.depth_z_m if own_buffers else None,
        own_shown=own_buffers.instance if own_buffers else None,
    )


def nearest_clip(camera: SceneCamera) -> float:
    """An orthographic camera may begin to see behind itself; a pinhole cannot."""
    return camera.clip_start if camera.type == "PERSP" else max(camera.clip_start, _NEAREST)


def _is_same_projection(a: Projection, b: Projection) -> bool:
    return all(
        math.isclose(getattr(a, name), getattr(b, name), rel_tol=_SAME)
        for name in ("fx", "fy", "cx", "cy")
    )


def submitted_camera(snapshot: Snapshot, size_wh: tuple[int, int]) -> SubmittedCamera:
    """The active camera at the size of the reference's picture."""
    camera, metres = snapshot.camera, snapshot.render.unit_scale
    own = projection(camera, snapshot.render, size_wh)
    hfov_deg = math.degrees(2 * math.atan(size_wh[0] / 2 / own.fx))
    if own.orthographic:
        own = replace(own, fx=own.fx / metres, fy=own.fy / metres)
    return SubmittedCamera(
        type=camera.type,
        hfov_deg=None if own.orthographic else hfov_deg,
        fx=own.fx,
        fy=own.fy,
        cx=own.cx,
        cy=own.cy,
        clip_start_m=camera.clip_start * metres,
        clip_end_m=camera.clip_end * metres,
        world_from_cam=pose_m(camera, metres),
    )


def pose_m(camera: SceneCamera, unit_scale: float) -> Pose:
    """(4, 4) world_from_cam in metres, OpenCV camera axes."""
    rows = [(*row[:3], row[3] * unit_scale) for row in camera.world_from_camera]
    return cast("Pose", (*rows, (0.0, 0.0, 0.0, 1.0)))


def surface_file(scene: str) -> str:
    """The surface file of an image (`scene`: its path without extension), relative to the run."""
    return f"surface/{scene}.npz"


def render_file(scene: str) -> str:
    """The render of an image, relative to the run."""
    return f"render/{scene}.png"


def write_surface(
    path: Path,
    surface: VisibleSurface,
    plane: NDArray[np.int16] | None = None,
    textures: NDArray[np.uint8] | None = None,
) -> None:
    """Write RUN/surface/<stem>.npz; shapes as in `records.submission`."""
    arrays: dict[str, NDArray[Any]] = {
        "depth_z_m": surface.depth_z_m,
        "intrinsics_px": _intrinsics(surface.projection),
    }
    if plane is not None and textures is not None:
        arrays |= {"plane": plane, "textures": textures}
    if surface.own_projection is not None and surface.own_depth_z_m is not None:
        arrays["own_depth_z_m"] = surface.own_depth_z_m
        arrays["own_intrinsics_px"] = _intrinsics(surface.own_projection)
    write_npz(path, arrays)


def _intrinsics(p: Projection) -> NDArray[np.float64]:
    return np.array([p.fx, p.fy, p.cx, p.cy], np.float64)
