"""Views that show too little: a camera inside of something, and flat meshes that face it.

A flat mesh that faces the camera is where a picture of the photo would hang.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.readouts.surface import VisibleSurface
from legoworld.scene.affine import cam_from_mesh, cross, dot, length, transform_points, unit
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.view import surfaces_through

#: A mesh is flat when no vertex is further from its plane than this share of its extent.
_FLAT: Final = 0.01
#: The share of the hits that one object has before it is asked what it hides. Not all of them: the
#: near clip plane cuts a hole into a wall that is nearer than it.
_FILLED: Final = 0.95
#: The share of its pixels that would show something else without it: else nothing is lost.
_HIDES: Final = 0.25
#: How much farther, at the median, that is. A room that is one mesh hides the ground outside of
#: it, at a few times the distance of its own walls, and is no mistake.
_FARTHER: Final = 4.0


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
    area = np.bincount(
        seen.surface_index[seen.surface_index >= 0], minlength=len(snapshot.surface_mesh)
    )
    large = np.flatnonzero(area >= max(1.0, min_share * seen.surface_index.size))
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
            share=int(area[surface]) / seen.surface_index.size,
        )
        for surface, tilt in facing
    ]
    return planes, number[np.where(seen.surface_index >= 0, seen.surface_index, -1)]


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


@dataclass(frozen=True, kw_only=True)
class FilledView:
    """The object that fills a view. share: of the hits; depth_m: the median of its depth there.

    hidden: objects that would be seen without it; farther: the median ratio of their depth to its.
    """

    object: str
    share: float
    depth_m: float
    hidden: int
    farther: float


def filled_view(
    snapshot: Snapshot, surface: VisibleSurface, *, threads: int | None = None
) -> FilledView | None:
    """What fills a view and hides the rest of the scene; None for any other view.

    An object is one occurrence, so of many copies each is its own. The view is drawn again without
    it, where it fills the view at all. A scene that is one object hides nothing.
    """
    hit = surface.surface_index >= 0
    if not hit.any():
        return None
    of_pixel = snapshot.surface_occurrence[surface.surface_index[hit]]
    area = np.bincount(of_pixel)
    owner = int(area.argmax())
    share = int(area[owner]) / len(of_pixel)
    if share < _FILLED:
        return None
    others = np.flatnonzero(snapshot.surface_occurrence != owner)
    behind = surfaces_through(
        surface.projection, with_surfaces(snapshot, others), surface.raster_wh, threads=threads
    )
    owned = np.zeros_like(hit)
    owned[hit] = of_pixel == owner
    hides = owned & (behind.instance >= 0)
    n_hides = int(np.count_nonzero(hides))
    if not n_hides or n_hides < _HIDES * int(area[owner]):
        return None
    near, far = surface.depth_z_m[hides], behind.depth_z_m[hides]
    farther = float(np.median(far.astype(np.float64) / near))
    if farther < _FARTHER:
        return None
    hidden = snapshot.surface_occurrence[others][behind.instance[hides]]
    return FilledView(
        object=snapshot.objects[int(snapshot.occurrence_object[owner])].name,
        share=share,
        depth_m=float(np.median(near)),
        hidden=len(np.unique(hidden)),
        farther=farther,
    )


def with_surfaces(snapshot: Snapshot, surfaces: NDArray[np.int64]) -> Snapshot:
    """The snapshot with these (n,) surfaces alone, in their order."""
    return replace(
        snapshot,
        surface_occurrence=snapshot.surface_occurrence[surfaces],
        surface_mesh=snapshot.surface_mesh[surfaces],
        surface_holdout=snapshot.surface_holdout[surfaces],
        world_from_mesh=snapshot.world_from_mesh[surfaces],
    )
