"""Points over the surface in a box: where they lie, how dense they are, what does not move them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from readouts.cubes import view_of

from legoworld.readouts.probing import FEWEST_POINTS, MOST_POINTS, Box, box_samples


def box(low, high, spacing=0.05):
    return Box(low=low, high=high, spacing_m=spacing)


AROUND = box((-1.0, -1.0, 4.0), (1.0, 1.0, 6.0))


def cube(*more, **options):
    return view_of(("cube", (0.0, 0.0, 5.0), 1.0), *more, **options)[0].snapshot


def test_points_lie_on_the_surface_and_their_number_is_its_area():
    (points,) = box_samples(cube(), [AROUND])
    assert points.dtype == np.float32
    assert len(points) == 2400
    off = np.abs(points - (0, 0, 5))
    assert np.allclose(off.max(axis=1), 0.5, atol=1e-5)
    on_each = [(np.abs(points[:, a] - c) < 1e-5).sum() for a in range(3) for c in
               ((-0.5, 0.5), (-0.5, 0.5), (4.5, 5.5))[a]]  # fmt: skip
    assert all(n >= 390 for n in on_each)
    assert sum(on_each) >= len(points)


@pytest.mark.parametrize(
    ("low", "high", "area"),
    [
        ((-1, -1, 4), (1, 1, 5), 1 + 4 * 0.5),  # the half that is nearer
        ((-1, -1, 4), (0, 0, 5), 0.25 + 2 * 0.25),  # a corner
        ((-0.25, -0.25, 4), (0.25, 0.25, 5), 0.25),  # inside one face
        ((-0.25, -0.25, 4.6), (0.25, 0.25, 5.4), 0.0),  # the hollow inside
        ((2, 2, 2), (3, 3, 3), 0.0),
    ],
)
def test_a_box_cuts_the_surface(low, high, area):
    (points,) = box_samples(cube(), [box(low, high, 0.03)])
    assert len(points) == (max(FEWEST_POINTS, round(area / 0.03**2)) if area else 0)
    assert (points >= np.array(low) - 1e-5).all()
    assert (points <= np.array(high) + 1e-5).all()


def test_a_wall_much_larger_than_the_box_gives_as_many_points_as_a_small_one():
    wall = view_of(("wall", (0.0, 0.0, 5.0), (500.0, 0.001, 500.0)))[0].snapshot
    small = view_of(("wall", (0.0, 0.0, 5.0), (1.0, 0.001, 1.0)))[0].snapshot
    inside = box((-0.25, -0.25, 4.0), (0.25, 0.25, 6.0), 0.02)
    (of_wall,), (of_small,) = box_samples(wall, [inside]), box_samples(small, [inside])
    assert len(of_wall) == len(of_small) == pytest.approx(2 * 0.25 / 0.02**2, abs=1)


def test_what_does_not_move_them():
    """The unit of the scene; other things outside of the box; hiding behind something else."""
    (plain,) = box_samples(cube(), [AROUND])
    (inches,) = box_samples(cube(unit_scale=0.0254), [AROUND])
    assert np.allclose(plain, inches, atol=1e-4)
    (crowded,) = box_samples(cube(("wall", (0.0, 0.0, 2.0), (9.0, 0.1, 9.0))), [AROUND])
    assert np.array_equal(plain, crowded)
    assert np.array_equal(plain, box_samples(cube(), [AROUND])[0])


def test_only_the_surfaces_that_are_asked_for():
    both = cube(("other", (0.4, 0.0, 5.0), 1.0))
    (first,) = box_samples(both, [AROUND], among=np.array([True, False]))
    assert np.array_equal(first, box_samples(cube(), [AROUND])[0])
    assert box_samples(both, [AROUND], among=np.array([False, False]))[0].shape == (0, 3)
    assert box_samples(both, []) == []


def test_more_surface_than_points_is_sampled_more_thinly():
    (points,) = box_samples(cube(), [replace(AROUND, spacing_m=1e-3)])
    assert len(points) == MOST_POINTS
