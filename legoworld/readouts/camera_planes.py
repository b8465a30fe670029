"""Flat meshes that face the camera: where a picture of the photo would hang."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.readouts.surface import VisibleSurface
from legoworld.scene.affine import cam_from_mesh, cross, dot, length, transform_points, unit
from legoworld.scene.snapshot import Snapshot

#: A mesh is flat when no vertex is further from its plane than this share of its extent.
_FLAT: Final = 0.01


@dataclass(frozen=True, kw_only=True)
class FacingPlane:
    """A flat surface turned to the camera. share: of the raster's pixels that show it."""

    object: str
    tilt_deg: float
    share: float


def facing_planes(
    snapshot: Snapshot, seen: VisibleSurface, *, max_tilt_deg: float, min_share: float
) -> tuple[list[FacingPlane], NDArray[np.int16]]:
    """The planes, largest first, and (H, W) int16 of their places in that list, -1 elsewhere.

    tilt_deg: angle between the plane's normal and the ray to its middle, to 0.1 degrees.
    """
    area = np.bincount(seen.shown[seen.shown >= 0], minlength=len(snapshot.surface_mesh))
    large = np.flatnonzero(area >= max(1.0, min_share * seen.shown.size))
    facing: list[tuple[int, float]] = []
    for surface in large.tolist():
        tilt = _tilt_deg(snapshot, surface)
        if tilt is not None and tilt <= max_tilt_deg:
            facing.append((surface, tilt))
    facing.sort(key=lambda item: (-int(area[item[0]]), item[0]))
    number = np.full(len(area) + 1, -1, np.int16)  # the last one: -1 stays -1
    number[[surface for surface, _ in facing]] = np.arange(len(facing), dtype=np.int16)
    planes = [
        FacingPlane(
            object=_name(snapshot, surface),
            tilt_deg=tilt,
            share=int(area[surface]) / seen.shown.size,
        )
        for surface, tilt in facing
    ]
    return planes, number[np.where(seen.shown >= 0, seen.shown, -1)]


def _name(snapshot: Snapshot, surface: int) -> str:
    occurrence = int(snapshot.surface_occurrence[surface])
    return snapshot.objects[int(snapshot.occurrence_object[occurrence])].name


def _tilt_deg(snapshot: Snapshot, surface: int) -> float | None:
    """The angle of a flat surface's normal to the ray through its middle; None for no plane."""
    mesh = int(snapshot.surface_mesh[surface])
    begin, end = snapshot.vertex_start[mesh], snapshot.vertex_start[mesh + 1]
    first, last = snapshot.triangle_start[mesh], snapshot.triangle_start[mesh + 1]
    placed = cam_from_mesh(snapshot.camera, snapshot.world_from_mesh[surface : surface + 1])[0]
    points = transform_points(placed, snapshot.vertices[begin:end].astype(np.float64))
    corners = points[snapshot.triangles[first:last]]
    normals = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = length(normals)
    if not len(areas) or not areas.max() > 0:
        return None
    normal = unit(normals[int(areas.argmax())])
    low, high = points.min(axis=0), points.max(axis=0)
    extent = float(length(high - low))
    if float(np.abs(dot(points - points[0], normal)).max()) > _FLAT * extent:
        return None
    ray = unit((low + high) / 2)
    cosine = min(1.0, abs(float(dot(ray, normal))))
    return round(float(np.degrees(np.arccos(cosine))), 1)
