"""What a correction is made of, against the projection itself; Blender is not asked."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scene.by_hand import CAMERA, RENDER

from legoworld.plugin.corrections import ViewedEntity
from legoworld.plugin.residuals import Shape
from legoworld.visibility.camera import projection

SIZE = (640, 480)
UNIT_M = 0.5
#: Looks forward and down, is turned and rolled, and lies off the origin.
POSE = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
EYE = np.array([1.0, -2.0, 3.0])


def entity(kind: str, own=(0.3, -0.4, 4.0), axes=POSE) -> ViewedEntity:
    """An entity at `own`: right, down and forward of the camera, metres."""
    axes = axes * np.sign(np.linalg.det(axes))
    pose = tuple(map(tuple, np.column_stack([axes, EYE / UNIT_M]).tolist()))
    camera = replace(CAMERA, type=kind, world_from_camera=pose, shift_x=0.1, shift_y=-0.2)
    render = replace(RENDER, unit_scale=UNIT_M, pixel_aspect_x=2.0)
    snapshot = SimpleNamespace(camera=camera, render=render)
    middle = EYE + axes @ np.asarray(own)
    return ViewedEntity(snapshot=snapshot, size_wh=SIZE, depth_m=own[2], middle_m=middle)


def pixel(one: ViewedEntity, world_m) -> np.ndarray:
    shot = one.snapshot
    camera = projection(shot.camera, shot.render, SIZE)
    x, y, z = one._axes().T @ (np.asarray(world_m) - EYE) / UNIT_M
    deep = 1.0 if camera.orthographic else z
    return np.array([camera.cx + camera.fx * x / deep, camera.cy + camera.fy * y / deep])


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_a_metre_in_the_world_is_so_many_pixels(kind):
    one, step = entity(kind), 1e-6
    assert one._eye_m() == pytest.approx(EYE)
    slopes = [
        (pixel(one, one.middle_m + step * way) - pixel(one, one.middle_m - step * way)) / (2 * step)
        for way in np.eye(3)
    ]
    assert one._pixels_per_metre() == pytest.approx(np.array(slopes).T, rel=1e-6, abs=1e-4)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_a_move_takes_the_centroid_to_the_region_s(kind):
    one = entity(kind)
    own = Shape(area_px=9, centroid_uv=(100.0, 90.0), extent_xywh=(0, 0, 20, 30))
    region = Shape(area_px=9, centroid_uv=(101.0, 88.0), extent_xywh=(0, 0, 10, 30))
    fix = one.towards(own, region, scaled=True)
    assert fix.scale == pytest.approx(0.5**0.5)
    assert one.towards(own, region, scaled=False).scale is None
    for move in (fix.move_m, fix.on_ground_m):
        moved = pixel(one, one.middle_m + 1e-3 * np.array(move)) - pixel(one, one.middle_m)
        assert moved * 1e3 == pytest.approx((1.0, -2.0), rel=1e-2)
    assert fix.on_ground_m[2] == 0
    assert one._axes()[:, 2] @ fix.move_m == pytest.approx(0, abs=1e-9)  # in the picture's plane


def test_to_another_depth_along_the_ray_or_the_axis():
    doubled = np.log(0.5)  # the present depth is half of what it should be
    one = entity("PERSP")
    moved = one.middle_m + one.along_ray(doubled).move_m
    assert one._axes().T @ (moved - EYE) == pytest.approx(2 * np.array([0.3, -0.4, 4.0]))
    one = entity("ORTHO")
    moved = one.middle_m + one.along_ray(doubled).move_m
    assert one._axes().T @ (moved - EYE) == pytest.approx((0.3, -0.4, 8.0))


def test_a_camera_that_looks_along_the_ground_tells_no_move_on_it():
    level = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])  # right, down, forward as columns
    own = Shape(area_px=9, centroid_uv=(100.0, 90.0), extent_xywh=(0, 0, 20, 30))
    higher = replace(own, centroid_uv=(100.0, 80.0))
    straight = entity("ORTHO", axes=level).towards(own, higher, scaled=False)
    assert straight.on_ground_m is None, "no move on the ground moves it up"
    assert straight.move_m[2] > 0
    near = entity("PERSP", own=(0.0, 0.1, 4.0), axes=level).towards(own, higher, scaled=False)
    assert near.on_ground_m is None, "one forty times as long as the move up"
    below = entity("PERSP", own=(0.0, 2.0, 4.0), axes=level).towards(own, higher, scaled=False)
    assert below.on_ground_m[1] == pytest.approx(2 * below.move_m[2])
