"""Which flat surfaces face the camera, and how much of the picture they own."""

from __future__ import annotations

import numpy as np
import pytest
from readouts.quads import BUMP, SQUARE, at, quads, rotation

from legoworld.readouts.filled_view import facing_planes
from legoworld.readouts.surface import visible_surface

SIZE, HFOV = (640, 480), 53.13010235415598


def planes_of(snapshot, *, max_tilt_deg=10.0, min_share=0.01):
    seen = visible_surface(snapshot, SIZE, HFOV)
    return seen, *facing_planes(snapshot, seen, max_tilt_deg=max_tilt_deg, min_share=min_share)


def test_a_square_that_faces_the_camera():
    seen, planes, number = planes_of(quads(("Poster", SQUARE, at(0, 0, 0))))
    (plane,) = planes
    assert (plane.object, plane.tilt_deg) == ("Poster", 0.0)
    assert plane.share == (seen.surface_index == 0).sum() / seen.surface_index.size
    assert number.dtype == np.int16
    assert number.shape == seen.surface_index.shape
    assert np.array_equal(number, np.where(seen.surface_index == 0, 0, -1))


@pytest.mark.parametrize(("degrees", "limit", "found"), [(9, 10, 1), (11, 10, 0), (11, 11, 1)])
def test_how_far_it_may_be_turned(degrees, limit, found):
    scene = quads(("Poster", SQUARE, at(0, 0, 0, rotation(degrees))))
    _, planes, number = planes_of(scene, max_tilt_deg=limit)
    assert [p.tilt_deg for p in planes] == [degrees] * found
    assert (number >= 0).any() == bool(found)


def test_the_tilt_is_to_the_ray_through_its_middle():
    # Upright, but 2 to the side at 10 units: seen at an angle of atan(.2).
    _, planes, _ = planes_of(quads(("Aside", SQUARE, at(2, 0, 0))), max_tilt_deg=20)
    assert planes[0].tilt_deg == round(float(np.degrees(np.arctan(0.2))), 1)


def test_either_side_of_a_plane_counts():
    _, planes, _ = planes_of(quads(("Back", SQUARE[::-1], at(0, 0, 0))))
    assert [p.tilt_deg for p in planes] == [0.0]


def test_the_largest_comes_first_and_equal_ones_in_the_scene_s_order():
    scene = quads(
        ("Small", SQUARE * 0.5, at(0, 2.5, 0)),
        ("Left", SQUARE, at(-2, 0, 0)),
        ("Right", SQUARE, at(2, 0, 0)),
    )
    seen, planes, number = planes_of(scene, max_tilt_deg=30)
    areas = [int((seen.surface_index == i).sum()) for i in range(3)]
    expected = sorted(range(3), key=lambda i: (-areas[i], i))
    assert [p.object for p in planes] == [("Small", "Left", "Right")[i] for i in expected]
    for place, surface in enumerate(expected):
        assert np.array_equal(number == place, seen.surface_index == surface)


def test_one_below_the_share_is_left_out():
    scene = quads(("Large", SQUARE * 2, at(0, 0, 0)), ("Small", SQUARE * 0.3, at(3.5, 0, 0)))
    _, both, _ = planes_of(scene, max_tilt_deg=30, min_share=0.0)
    assert [p.object for p in both] == ["Large", "Small"]
    _, one, number = planes_of(scene, max_tilt_deg=30, min_share=both[1].share * 1.01)
    assert [p.object for p in one] == ["Large"]
    assert set(np.unique(number)) == {-1, 0}
    _, exactly, _ = planes_of(scene, max_tilt_deg=30, min_share=both[1].share)
    assert [p.object for p in exactly] == ["Large", "Small"]


def test_what_is_hidden_is_no_plane_whatever_the_share():
    scene = quads(("Front", SQUARE * 2, at(0, 0, 1)), ("Hidden", SQUARE, at(0, 0, 0)))
    _, planes, _ = planes_of(scene, min_share=0.0)
    assert [p.object for p in planes] == ["Front"]


def test_a_mesh_that_stands_out_is_no_plane():
    _, planes, number = planes_of(quads(("Bump", BUMP, at(0, 0, 0))))
    assert planes == []
    assert (number == -1).all()
    flat = BUMP.copy()
    flat[4, 2] = 0.02  # under a hundredth of its extent, which is 2.8
    _, planes, _ = planes_of(quads(("Flat", flat, at(0, 0, 0))))
    assert [p.object for p in planes] == ["Flat"]
    flat[4, 2] = 0.04
    assert planes_of(quads(("Raised", flat, at(0, 0, 0))))[1] == []


def test_the_plane_is_that_of_the_largest_triangle():
    # The first triangle is degenerate: its normal would be nothing.
    corners = np.array([[0, 0, 0], [0, 0, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * 2
    _, planes, _ = planes_of(quads(("Half", corners, at(0, -1, 0))), max_tilt_deg=20)
    assert [p.object for p in planes] == ["Half"]
