"""Where a look at a scene is from: one of its cameras, around an object, or two points."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import UsageError
from legoworld.plugin.entities import Entities
from legoworld.records.base import Record
from legoworld.scene.snapshot import SceneCamera, Snapshot
from legoworld.visibility.camera import projection

F64 = NDArray[np.float64]
_Point = tuple[float, float, float]

#: The sphere around an entity fills this share of the picture's shorter side.
_FILLS: Final = 0.75


class Viewpoint(Record, frozen=True, kw_only=True):
    """A viewpoint; without any field the active camera's.

    camera: a camera of the scene by name. around: an object or collection that the picture is
    turned to and filled by, seen from azimuth_deg to the right of the active camera and
    elevation_deg above the ground; what stands before it is cut away. from_m, to_m: two points of
    the world.
    """

    camera: str | None = None
    around: str | None = None
    azimuth_deg: float = 0.0
    elevation_deg: float = 30.0
    from_m: _Point | None = None
    to_m: _Point | None = None


def find_camera(snapshot: Snapshot, at: Viewpoint) -> SceneCamera:
    """A named camera, or the active one's optics at another pose. UsageError for none of them."""
    own, scale = snapshot.camera, snapshot.render.unit_scale
    ahead = _level(np.array(own.world_from_camera))
    match at:
        case Viewpoint(camera=None, around=None, from_m=None, to_m=None):
            return own
        case Viewpoint(camera=str(name), around=None, from_m=None, to_m=None):
            by_name = {camera.name: camera for camera in snapshot.cameras}
            if name in by_name:
                return by_name[name]
            expected = " or ".join(by_name)
        case Viewpoint(camera=None, around=str(name), from_m=None, to_m=None):
            entities = Entities(snapshot)
            if len(points := entities.points_m(name)):
                return _orbit(snapshot, points / scale, ahead, at)
            expected = " or ".join(entities.nearest(name)) or "an object with a surface"
        case Viewpoint(camera=None, around=None, from_m=tuple(eye), to_m=tuple(target)):
            if eye != target:
                pose = _pose(np.array(eye) / scale, np.array(target) / scale, ahead)
                return replace(own, world_from_camera=pose)
            name, expected = "one point", "two points"
        case _:
            name, expected = "several, or half of one", "camera, or around, or from_m and to_m"
    raise UsageError("there is no such viewpoint", found=name, expected=expected)


def _orbit(snapshot: Snapshot, points: F64, ahead: F64, at: Viewpoint) -> SceneCamera:
    own = snapshot.camera
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-6)
    through = projection(own, snapshot.render, (2, 2))
    # An orthographic camera keeps its scale.
    away = 3 * radius if through.orthographic else radius / math.sin(math.atan(_FILLS / through.fx))
    azimuth, elevation = math.radians(at.azimuth_deg), math.radians(at.elevation_deg)
    right = np.array([ahead[1], -ahead[0], 0.0])
    flat = math.sin(azimuth) * right - math.cos(azimuth) * ahead
    way = math.cos(elevation) * flat + math.sin(elevation) * np.array([0.0, 0.0, 1.0])
    return replace(
        own,
        world_from_camera=_pose(middle + away * way, middle, -flat),
        clip_start=max(away - 1.05 * radius, away / 1000),
        clip_end=max(own.clip_end, 100 * away),
    )


def _level(world_from_camera: F64) -> F64:
    """The horizontal direction that a camera looks in; its picture's up where it looks down."""
    for way in (world_from_camera[:, 2], -world_from_camera[:, 1]):
        if (size := math.hypot(way[0], way[1])) > 0.1:
            break
    return np.array([way[0], way[1], 0.0]) / size


def _pose(eye: F64, target: F64, ahead: F64) -> tuple[tuple[float, float, float, float], ...]:
    """(3, 4) world from camera, upright. ahead: what is up in a picture from straight above."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
    return tuple((float(x), float(y), float(z), float(at)) for x, y, z, at in axes)
