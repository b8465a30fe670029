"""Scenes of rows 28 to 31: cameras, units and frames."""

from __future__ import annotations

import math
from typing import Any

import bpy
from cases.stage import box, camera, empty, pixel_camera, square


def _matrix(made: Any) -> dict[str, Any]:
    """Blender's own projection matrix at the scene's resolution."""
    render = bpy.context.scene.render
    bpy.context.view_layer.update()
    width = render.resolution_x * render.resolution_percentage // 100
    height = render.resolution_y * render.resolution_percentage // 100
    matrix = made.calc_matrix_camera(
        bpy.context.evaluated_depsgraph_get(),
        x=width,
        y=height,
        scale_x=render.pixel_aspect_x,
        scale_y=render.pixel_aspect_y,
    )
    return {"size_wh": [width, height], "matrix": [list(row) for row in matrix]}


def portrait() -> dict[str, Any]:
    made = camera((0, 0, 10), lens=50.0, sensor_width=36.0, sensor_fit="AUTO")
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 480, 640
    square("Plane", 1)
    return _matrix(made)


def shifted_and_stretched() -> dict[str, Any]:
    made = camera((0, 0, 10), lens=35.0, shift_x=0.1, shift_y=-0.05)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 641, 427, 50
    render.pixel_aspect_y = 2.0
    square("Plane", 1)
    return _matrix(made)


def vertical_fit() -> dict[str, Any]:
    made = camera((0, 0, 10), lens=35.0, sensor_fit="VERTICAL", sensor_height=20.0, shift_y=0.2)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 640, 360
    render.pixel_aspect_x = 1.5
    square("Plane", 1)
    return _matrix(made)


def horizontal_portrait() -> dict[str, Any]:
    made = camera((0, 0, 10), lens=35.0, sensor_fit="HORIZONTAL", shift_x=-0.2)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 300, 700
    square("Plane", 1)
    return _matrix(made)


def orthographic() -> dict[str, Any]:
    made = camera((0, 0, 10), type="ORTHO", ortho_scale=7.0, shift_x=0.1, shift_y=0.3)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 300, 700
    slope = square("Slope", 4)
    slope.rotation_euler[1] = math.pi / 4
    return _matrix(made)


def scaled_camera() -> None:
    holder = empty("Holder")
    holder.scale = (3, 0.2, 7)
    made = camera((0, 0, 0.5), lens=36.0)
    made.parent = holder
    made.location.z = 5 / 7
    square("Plane", 100)


def panoramic() -> None:
    camera((0, 0, 10), type="PANO")
    square("Plane", 1)


def no_camera() -> None:
    square("Plane", 1)


def centimetres() -> None:
    scene = bpy.context.scene
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.01
    pixel_camera()
    box("Plane", 0, 0, 80, 60)


def saved_frame() -> None:
    scene = bpy.context.scene
    pixel_camera()
    mover = box("Mover", 0, 0, 10, 10)
    for frame, x in ((1, 0.0), (11, 100.0)):
        mover.location.x = x
        mover.keyframe_insert("location", frame=frame)
    for curve in mover.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for key in curve.keyframe_points:
            key.interpolation = "LINEAR"
    scene.frame_set(4)


def marker_camera() -> None:
    scene = bpy.context.scene
    first = camera((0, 0, 50))
    second = camera((0, 0, 5))
    square("Plane", 200)
    scene.camera = first
    scene.timeline_markers.new("cut", frame=3).camera = second
    scene.frame_current = 7
