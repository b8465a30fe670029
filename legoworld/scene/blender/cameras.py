"""The active camera of an evaluated scene, in Blender's conventions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, cast

from legoworld.conventions import CV_FROM_BLENDER_CAMERA
from legoworld.errors import NoCameraError, NonFiniteGeometryError, UnsupportedCameraError
from legoworld.pluralize import plural
from legoworld.scene.snapshot import LARGEST_COORDINATE, SceneCamera

if TYPE_CHECKING:
    import bpy
    import mathutils

_Pose = tuple[tuple[float, float, float, float], ...]


def refuse_missing_camera(scene: bpy.types.Scene) -> None:
    """Raise NoCameraError if the scene has no camera and no marker binds one."""
    if scene.camera is not None or any(m.camera for m in scene.timeline_markers):
        return
    names = sorted(o.name for o in scene.objects if o.type == "CAMERA")
    raise NoCameraError(
        "the scene has no active camera",
        found=f"{plural(len(names), 'camera object', 'camera objects')}, none active: "
        + ", ".join(names[:5])
        if names
        else "no camera object",
        expected="scene.camera set to the camera that matches the photo",
        next_step="set bpy.context.scene.camera in the scene program",
    )


def add_missing_camera(scene: bpy.types.Scene) -> None:
    """Give a scene that has no camera, as `refuse_missing_camera` judges it, one at its origin."""
    import bpy

    try:
        refuse_missing_camera(scene)
    except NoCameraError:
        scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(scene.camera)


def scene_camera(scene: bpy.types.Scene) -> SceneCamera:
    """The camera a render of an evaluated scene uses.

    Raises NoCameraError, UnsupportedCameraError or NonFiniteGeometryError.
    """
    return _read_camera(scene.camera)


def scene_cameras(graph: bpy.types.Depsgraph) -> tuple[SceneCamera, ...]:
    """The cameras of an evaluated scene by name, without those that cannot be read.

    One that is hidden from rendering or excluded has no pose of the render, unless it is active.
    """
    cameras: dict[str, SceneCamera] = {}
    for holder in sorted(graph.objects, key=lambda o: o.name):
        if holder.type == "CAMERA" and holder.name not in cameras:
            with suppress(UnsupportedCameraError, NonFiniteGeometryError):
                cameras[holder.name] = _read_camera(holder)
    return tuple(cameras.values())


def _read_camera(holder: bpy.types.Object | None) -> SceneCamera:
    if holder is None or holder.type != "CAMERA":
        kind = "nothing" if holder is None else f"{holder.type.lower()} object {holder.name!r}"
        raise NoCameraError(
            "the scene's active camera is not a camera",
            found=kind,
            expected="a camera object",
            next_step="set bpy.context.scene.camera in the scene program",
        )
    camera = holder.data
    if camera.type not in ("PERSP", "ORTHO"):
        raise UnsupportedCameraError(
            f"camera {holder.name!r} cannot be read out",
            found=f"camera type {camera.type}",
            expected="PERSP or ORTHO",
            next_step="use a perspective camera that matches the photo",
        )
    pose = _pose(holder.matrix_world)
    numbers = {
        "lens_mm": camera.lens,
        "sensor_width_mm": camera.sensor_width,
        "sensor_height_mm": camera.sensor_height,
        "shift_x": camera.shift_x,
        "shift_y": camera.shift_y,
        "ortho_scale": camera.ortho_scale,
        "clip_start": camera.clip_start,
        "clip_end": camera.clip_end,
    }
    _refuse_broken(holder.name, camera.type, numbers, pose)
    return SceneCamera(
        name=holder.original.name,
        type=camera.type,
        world_from_camera=pose,
        sensor_fit=camera.sensor_fit,
        **numbers,
    )


def _refuse_broken(name: str, kind: str, numbers: Mapping[str, float], pose: _Pose) -> None:
    placed = (x for row in pose for x in row)
    if not all(math.isfinite(x) for x in numbers.values()) or not all(
        abs(x) <= LARGEST_COORDINATE for x in placed
    ):
        raise NonFiniteGeometryError(
            f"camera {name!r} is broken",
            found="NaN or infinity in its settings, or in its matrix, or a place beyond "
            f"{LARGEST_COORDINATE:g}",
            expected="finite numbers",
            next_step="correct the camera's transform and lens",
        )
    positive = ["lens_mm", "sensor_width_mm", "sensor_height_mm"]
    positive = [*positive, "clip_start"] if kind == "PERSP" else ["ortho_scale"]
    wrong = [f"{key} {numbers[key]:g}" for key in positive if not numbers[key] > 0.0]
    if not numbers["clip_start"] < numbers["clip_end"]:
        wrong.append(f"clip_start {numbers['clip_start']:g}, clip_end {numbers['clip_end']:g}")
    if _flat(pose):
        wrong.append("a scale of 0")
    if wrong:
        raise UnsupportedCameraError(
            f"camera {name!r} sees nothing",
            found=", ".join(wrong),
            expected="a scale other than 0, positive lens and sensor, clip_start below clip_end",
            next_step="correct the camera's transform and settings",
        )


def _pose(world_from_object: mathutils.Matrix) -> _Pose:
    """The camera's pose in OpenCV axes.

    The scale of each axis is removed, as a Blender render removes it; axes that are not at right
    angles, or left-handed, stay so.
    """
    unscaled = world_from_object.normalized()
    signs = (*CV_FROM_BLENDER_CAMERA, 1.0)
    rows = tuple(tuple(float(unscaled[r][c]) * signs[c] for c in range(4)) for r in range(3))
    return cast("_Pose", rows)


def _flat(pose: _Pose) -> bool:
    (a, b, c, _), (d, e, f, _), (g, h, i, _) = pose
    return abs(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)) < 1e-6
