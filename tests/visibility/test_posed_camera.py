"""A camera with a pose in Blender's terms and back: the same rays."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scene.by_hand import CAMERA, RENDER

from legoworld.visibility.camera import projection
from legoworld.visibility.posed_camera import Camera, place_scene_camera

POSE = ((0.0, -1.0, 0.0, 2.0), (1.0, 0.0, 0.0, -3.0), (0.0, 0.0, 1.0, 4.0))
SCENE = SimpleNamespace(camera=CAMERA)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("size_wh", [(640, 480), (300, 700)])
@pytest.mark.parametrize("clip", [None, (0.5, 60.0)])
def test_blender_s_terms_are_the_same_projection(orthographic, size_wh, clip):
    camera = Camera(
        name="here", world_from_cam=POSE, size_wh=size_wh, fx=410.0, fy=410.0, cx=300.0, cy=270.0,
        orthographic=orthographic, clip=clip,
    )  # fmt: skip
    placed = camera.placed_in(SCENE)
    assert (placed.name, placed.world_from_camera) == ("here", POSE)
    found, given = projection(placed, RENDER, size_wh), camera.projection(SCENE)
    assert (found.orthographic, found.z_near, found.z_far) == (
        orthographic, *(clip or (CAMERA.clip_start, CAMERA.clip_end)),
    )  # fmt: skip
    for lens in (found, given):
        assert (lens.fx, lens.fy, lens.cx, lens.cy) == pytest.approx((410, 410, 300, 270))
    back = place_scene_camera(placed, RENDER, size_wh)
    assert pytest.approx(camera.K) == back.K
    assert (back.world_from_cam, back.orthographic) == (POSE, orthographic)
    assert back.clip == (found.z_near, found.z_far)
    assert (back.name, back.lens) == ("here", None)


def test_an_orthographic_camera_keeps_the_scene_s_lens():
    camera = Camera(name="", world_from_cam=POSE, size_wh=(10, 10), fx=1, fy=1, cx=5, cy=5)
    scene = SimpleNamespace(camera=replace(CAMERA, lens_mm=77.0))
    assert replace(camera, orthographic=True).placed_in(scene).lens_mm == 77.0


def test_the_world_in_the_camera_s_axes():
    camera = Camera(name="a", world_from_cam=POSE, size_wh=(4, 2), fx=3, fy=2, cx=1, cy=0.5)
    world_from_cam = np.vstack([POSE, (0, 0, 0, 1)])
    assert camera.cam_from_world @ world_from_cam == pytest.approx(np.eye(4))
    assert camera.K.tolist() == [[3, 0, 1], [0, 2, 0.5], [0, 0, 1]]
    other = replace(camera, name="b", world_from_cam=((1, 0, 0, 9), (0, 1, 0, 0), (0, 0, 1, 0)))
    assert camera.anywhere() == other.anywhere()
    assert camera.anywhere() != replace(other, fx=4).anywhere()
