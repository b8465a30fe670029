"""Which sizes count as another aspect than the scene's own picture."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scene.by_hand import HandScene

from legoworld.visibility.camera import aspect_differs, projection


@pytest.mark.parametrize(
    ("own", "size_wh", "differs"),
    [
        ((640, 480), (640, 480), False),
        ((640, 480), (320, 240), False),
        ((640, 480), (1280, 961), False),  # 1280 * 480 - 961 * 640 = -640: half the tolerance
        ((640, 480), (1280, 962), False),  # exactly the tolerance of 1280
        ((640, 480), (1280, 963), True),  # half as much again
        ((640, 480), (1280, 957), True),
        ((100, 100), (101, 100), False),
        ((100, 100), (102, 100), True),
        ((480, 640), (640, 480), True),
    ],
)
def test_one_pixel_of_rounding_is_no_other_aspect(own, size_wh, differs):
    scene = HandScene()
    scene.object("A")
    scene.occurs("A")
    render = replace(
        scene.snapshot().render,
        resolution_x=own[0],
        resolution_y=own[1],
        resolution_percentage=100,
    )
    assert aspect_differs(render, size_wh) is differs


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize(
    ("shift", "size_wh", "aspect", "centre"),
    [
        ((0.1, 0.0), (200, 100), (1, 1), (80.0, 50.0)),
        ((0.0, 0.1), (200, 100), (1, 1), (100.0, 70.0)),  # up: the axis is lower in the picture
        ((0.0, 0.1), (100, 200), (1, 1), (50.0, 120.0)),  # of the longer side
        ((0.0, 0.1), (200, 100), (1, 2), (100.0, 60.0)),  # 200 wide, in pixels twice as high
    ],
)
def test_shift_is_in_shares_of_the_fitted_side(kind, shift, size_wh, aspect, centre):
    scene = HandScene()
    scene.object("A")
    scene.occurs("A")
    shot = scene.snapshot()
    camera = replace(shot.camera, type=kind, sensor_fit="AUTO", shift_x=shift[0], shift_y=shift[1])
    render = replace(shot.render, pixel_aspect_x=aspect[0], pixel_aspect_y=aspect[1])
    found = projection(camera, render, size_wh)
    assert (found.cx, found.cy) == pytest.approx(centre)
