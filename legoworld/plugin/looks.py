"""A look at the live scene: from any camera, beside the photo, or before and after an edit."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import UsageError
from legoworld.plugin.case import STATES, Case
from legoworld.plugin.entities import Entities
from legoworld.plugin.small_render import render_copy
from legoworld.plugin.state import LiveScene, read_live
from legoworld.readouts.pictures import Rgb, instance_picture, png_bytes
from legoworld.records.base import Record, as_json
from legoworld.records.plugin_evidence import Sha256
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.instances import group
from legoworld.scene.labels import Labels
from legoworld.scene.pictures import decoded_picture
from legoworld.scene.requests import StandRequest
from legoworld.scene.snapshot import SceneCamera, Snapshot
from legoworld.visibility.camera import projection
from legoworld.visibility.view import view

Beside = Literal["nothing", "photo", "before"]
Draw = Literal["render", "geometry"]
F64 = NDArray[np.float64]
_Row = tuple[float, float, float, float]

#: Pixels of each pane's longer side. Models count about one token for 750 pixels.
PANE_PX: Final = 256
LARGEST_PANE_PX: Final = 640
_SAMPLES: Final = 16
#: An entity's sphere fills this share of the picture's shorter side.
_FILLS: Final = 0.75
#: So many colours of objects.
_COLORS: Final = 1000


class Viewpoint(Record, frozen=True, kw_only=True):
    """Where a look is from; without any field the active camera.

    camera: a camera of the scene by name. around: an object or collection that the picture is
    turned to and filled by, seen from azimuth_deg to the right of the active camera and
    elevation_deg above the ground; what stands before it is cut away. from_m, to_m: two points of
    the world.
    """

    camera: str | None = None
    around: str | None = None
    azimuth_deg: float = 0.0
    elevation_deg: float = 30.0
    from_m: tuple[float, float, float] | None = None
    to_m: tuple[float, float, float] | None = None


class Look(Record, frozen=True, kw_only=True):
    """A picture of the live scene. panes: what it shows from left to right; size_wh: of each."""

    picture_sha256: Sha256
    panes: tuple[str, ...]
    size_wh: tuple[int, int]


def look(
    case: Case, at: Viewpoint, *, beside: Beside, draw: Draw, pane_px: int
) -> tuple[Look, bytes]:
    """Look at the scene as it is now; the picture is a PNG.

    beside: "photo" puts the photo at its left, "before" the scene as the open transaction found it,
    and their difference at its right. UsageError for what cannot be looked at.
    """
    made: list[bytes] = []

    def call() -> Look:
        before = _kept_before(case) if beside == "before" else None
        renderer = case.live.reader if draw == "render" else None
        with case.live.save_copy() as copy:
            scene = read_live(copy.path, case.live.reader)
            case.note(scene)
            camera = find_camera(scene.snapshot, at)
            size = _pane_wh(case, scene.snapshot, pane_px)
            panes = {"scene": _drawn(copy.path, scene, camera, size, renderer)}
            if beside == "photo":
                panes = {"photo": _photo(case, at, size), **panes}
            elif before is not None:
                copy.put(before)  # where it finds what it names by relative paths
                then = read_live(copy.path, case.live.reader)
                panes = {"before": _drawn(copy.path, then, camera, size, renderer), **panes}
        if len(panes) == 2:
            panes["difference"] = difference(*panes.values())
        made.append(png_bytes(np.concatenate(list(panes.values()), axis=1)))
        sha256 = case.artefacts.keep(made[0], "png")
        return Look(picture_sha256=sha256, panes=tuple(panes), size_wh=size)

    request = {"at": as_json(at), "beside": beside, "draw": draw, "pane_px": pane_px}
    return case.record("look", request, call), made[0]


def find_camera(snapshot: Snapshot, at: Viewpoint) -> SceneCamera:
    """The camera of a viewpoint: a named one, or the active one's optics at another pose."""
    given = [at.camera is not None, at.around is not None, at.from_m is not None]
    if sum(given) > 1 or (at.from_m is None) != (at.to_m is None):
        raise UsageError(
            "the viewpoint is not one",
            found=", ".join(n for n in ("camera", "around", "from_m", "to_m") if getattr(at, n)),
            expected="camera, or around, or from_m and to_m, or none of them",
        )
    own = snapshot.camera
    if at.camera is not None:
        found = next((c for c in snapshot.cameras if c.name == at.camera), None)
        if found is None:
            names = ", ".join(c.name for c in snapshot.cameras)
            raise UsageError("the scene has no such camera", found=at.camera, expected=names)
        return found
    scale = snapshot.render.unit_scale
    ahead = _level(np.array(own.world_from_camera))
    if at.from_m is not None and at.to_m is not None:
        eye, target = np.array(at.from_m) / scale, np.array(at.to_m) / scale
        if np.allclose(eye, target):
            raise UsageError("from_m and to_m are one point", found=str(at.from_m))
        return replace(own, world_from_camera=_pose(eye, target, ahead))
    if at.around is None:
        return own
    points = Entities(snapshot).points_m(at.around) / scale
    if not len(points):
        near = Entities(snapshot).nearest(at.around)
        raise UsageError(
            "there is nothing of that name to look at",
            found=at.around,
            expected=" or ".join(near) or "an object or a collection with a surface",
        )
    return _orbit(snapshot, points, ahead, at)


def _orbit(snapshot: Snapshot, points: F64, ahead: F64, at: Viewpoint) -> SceneCamera:
    own = snapshot.camera
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-6)
    through = projection(own, snapshot.render, (1000, 1000))
    half = 500 * _FILLS / through.fx  # an orthographic camera keeps its scale
    away = 3 * radius if through.orthographic else radius / math.sin(math.atan(half))
    azimuth, elevation = math.radians(at.azimuth_deg), math.radians(at.elevation_deg)
    right = np.array([ahead[1], -ahead[0], 0.0])
    flat = -math.cos(azimuth) * ahead + math.sin(azimuth) * right
    up = np.array([0.0, 0.0, 1.0])
    eye = middle + away * (math.cos(elevation) * flat + math.sin(elevation) * up)
    return replace(
        own,
        world_from_camera=_pose(eye, middle, -flat),
        clip_start=max(away - 1.05 * radius, away / 1000),
        clip_end=max(own.clip_end, 100 * away),
    )


def _level(world_from_camera: F64) -> F64:
    """The horizontal direction that a camera looks in; its picture's up where it looks down."""
    for way in (world_from_camera[:, 2], -world_from_camera[:, 1]):
        flat = np.array([way[0], way[1], 0.0])
        if (size := float(np.linalg.norm(flat))) > 0.1:
            return np.asarray(flat / size)
    return np.array([0.0, 1.0, 0.0])


def _pose(eye: F64, target: F64, ahead: F64) -> tuple[_Row, ...]:
    """(3, 4) world from camera, upright. ahead: what is up in a picture from straight above."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
    return tuple((float(x), float(y), float(z), float(at)) for x, y, z, at in axes)


def difference(first: Rgb, second: Rgb) -> Rgb:
    """White where two pictures agree; red where the second is brighter, blue where it is darker."""
    apart = second.astype(np.int16) - first
    size = 255 - np.abs(apart).max(axis=2)
    brighter = apart.sum(axis=2) >= 0
    full = np.full_like(size, 255)
    shown = np.stack([np.where(brighter, full, size), size, np.where(brighter, size, full)], axis=2)
    return np.ascontiguousarray(shown, np.uint8)


def draw_geometry(snapshot: Snapshot, size_wh: tuple[int, int]) -> Rgb:
    """Each object in a colour that its name decides, darker where it is seen at a slant."""
    grouping = group(snapshot, Labels(objects={}, collections={}, warnings=()))
    seen = view(snapshot, grouping, size_wh, exact=False, normals="geometric")
    numbers = np.array([crc32(i.name.encode()) % _COLORS for i in grouping.instances] + [-1])
    towards = np.nan_to_num(np.abs(seen.normals().normal_cam[:, :, 2:]))
    colored = instance_picture(numbers[seen.buffers.instance].astype(np.int32))
    return np.asarray(colored * (0.6 + 1.4 * towards), np.uint8)


def _drawn(
    blend: Path,
    scene: LiveScene,
    camera: SceneCamera,
    size_wh: tuple[int, int],
    renderer: BlenderProcess | None,
) -> Rgb:
    """Rendered by Cycles; without a renderer the kernel's drawing."""
    if renderer is None:
        return draw_geometry(replace(scene.snapshot, camera=camera), size_wh)
    own, stand = scene.snapshot.camera, None
    if camera != own:
        stand = StandRequest(
            world_from_camera=camera.world_from_camera,
            zoom=1.0,
            clip=(camera.clip_start, camera.clip_end),
        )
        if camera.name != own.name:
            stand["camera"] = camera.name
    png = render_copy(blend, renderer, size_wh, samples=_SAMPLES, denoise=True, stand=stand)
    picture = decoded_picture(png, color=True)
    assert picture is not None  # our own PNG
    return np.ascontiguousarray(picture[:, :, ::-1])


def _pane_wh(case: Case, snapshot: Snapshot, pane_px: int) -> tuple[int, int]:
    wide, high = case.evidence.size_wh if case.evidence else snapshot.render.size_wh
    if not 16 <= pane_px <= LARGEST_PANE_PX:
        raise UsageError(
            "a pane is not that large", found=str(pane_px), expected=f"16 to {LARGEST_PANE_PX}"
        )
    shrink = pane_px / max(wide, high)
    return max(1, round(wide * shrink)), max(1, round(high * shrink))


def _photo(case: Case, at: Viewpoint, size: tuple[int, int]) -> Rgb:
    import cv2

    photo = case.evidence.photo if case.evidence else None
    if photo is None or at != Viewpoint():
        raise UsageError(
            "the photo cannot be put beside it",
            found="no photo" if photo is None else "another camera than the active one",
            expected="a server with --photo, and no viewpoint",
        )
    return np.asarray(cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.uint8)


def _kept_before(case: Case) -> Path:
    """The copy that the open transaction would return to. TransactionError without one."""
    return case.folder / STATES / f"{case.begun_entry().answer['base_sha256']}.blend"
