"""Which sizes count as another aspect than the scene's own picture."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scene.by_hand import HandScene

from legoworld.visibility.camera import aspect_differs


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
