"""When one object is all that a camera sees, and when that is no mistake."""

from __future__ import annotations

import numpy as np
import pytest
from readouts.quads import SQUARE, at, quads

from legoworld.readouts.filled_view import filled_view
from legoworld.readouts.surface import visible_surface

SIZE, HFOV = (640, 480), 53.13010235415598
#: The camera stands at z = 10: a square this large fills the view from any place before it.
LARGE = SQUARE * 20


def fill_view(*placed):
    scene = quads(*placed)
    return filled_view(scene, visible_surface(scene, SIZE, HFOV))


def test_a_wall_before_the_camera_is_named_with_what_it_hides():
    found = fill_view(("Wall", LARGE, at(0, 0, 9)), ("Near", LARGE, at(-19, 0, 2)),
                   ("Far", LARGE, at(0, 0, 0)), ("Behind", LARGE, at(0, 0, 20)))  # fmt: skip
    assert found is not None
    assert (found.object, found.share, found.hidden) == ("Wall", 1.0, 2)
    assert found.depth_m == pytest.approx(1.0)
    assert found.farther == pytest.approx(8.0)


@pytest.mark.parametrize(("z", "warned"), [(7.6, True), (7.4, False)])
def test_a_wall_at_a_fourth_of_the_distance_is_near(z, warned):
    """A room that is one mesh hides the ground outside of it; that is at a few times its walls."""
    found = fill_view(("Wall", LARGE, at(0, 0, z)), ("Scene", LARGE, at(0, 0, 0)))
    assert bool(found) is warned


@pytest.mark.parametrize(("half", "warned"), [(0.49, True), (0.40, False)])
def test_an_object_seen_beside_it_is_enough_to_see_the_scene(half, warned):
    """Half of the view is 0.5 x 0.375 at 1 unit; a wall narrower than that shows the scene."""
    wall = SQUARE * np.array([half, 1, 1], np.float32)
    found = fill_view(("Wall", wall, at(0, 0, 9)), ("Scene", LARGE, at(0, 0, 0)))
    assert bool(found) is warned


@pytest.mark.parametrize(("half", "warned"), [(4.0, True), (1.5, False)])
def test_what_hides_little_is_the_subject(half, warned):
    """Half of the view is 5 x 3.75 at the scene's distance, of which a fourth must be hidden."""
    found = fill_view(("Wall", LARGE, at(0, 0, 9)), ("Scene", SQUARE * half, at(0, 0, 0)))
    assert bool(found) is warned


@pytest.mark.parametrize(("hidden", "warned"), [(0.235, True), (0.225, False)])
def test_a_fourth_is_of_the_object_and_not_of_the_view(hidden, warned):
    """The wall has 0.92 of the picture, something beside it 0.04; a fourth of the wall is 0.23."""
    wall = SQUARE * np.array([0.46, 20, 1], np.float32)
    half = (hidden * 10 * 7.5) ** 0.5 / 2
    found = fill_view(("Wall", wall, at(0, 0, 9)), ("Beside", LARGE, at(20.46, 0, 9)),
                   ("Scene", SQUARE * half, at(0, 0, 0)))  # fmt: skip
    assert bool(found) is warned


def test_one_object_alone_and_none_at_all_hide_nothing():
    assert fill_view(("Wall", LARGE, at(0, 0, 9))) is None
    assert fill_view(("Behind", LARGE, at(0, 0, 20))) is None


def test_the_share_is_of_what_is_seen_and_not_of_the_sky():
    """A wall on half of the picture; above and below of it is sky, which is no part of the view."""
    half = SQUARE * np.array([20, 0.2, 1], np.float32)
    hidden = SQUARE * np.array([2, 1.8, 1], np.float32)  # 0.19 of the picture, the wall has 0.53
    found = fill_view(("Wall", half, at(0, 0, 9)), ("Scene", hidden, at(0, 0, 0)))
    assert found is not None
    assert (found.object, found.share, found.hidden) == ("Wall", 1.0, 1)
