"""Solids in the world against answers that were worked out another way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from solids.boxes import about, box

from legoworld.solids.hulls import facing_angles_deg
from legoworld.solids.penetration import penetration_m
from legoworld.solids.solid import Solid
from legoworld.solids.support import centre_of_mass, rest_on


def separating_axes(first, second):
    """Least overlap over the 15 axes of two boxes (Gottschalk, Lin, Manocha 1996, OBBTree)."""
    axes = [[np.cross(t[1] - t[0], t[2] - t[0]) for t in box[::4]] for box in (first, second)]
    axes = [[n / np.linalg.norm(n) for n in own] for own in axes]
    crossed = [np.cross(a, b) for a in axes[0] for b in axes[1]]
    crossed = [c / np.linalg.norm(c) for c in crossed if np.linalg.norm(c) > 1e-9]
    overlaps = []
    for axis in [*axes[0], *axes[1], *crossed]:
        one, two = (each.reshape(-1, 3) @ axis for each in (first, second))
        overlaps.append(min(one.max() - two.min(), two.max() - one.min()))
    return max(0.0, min(overlaps))


def within(inner, outer):
    normals = np.array([np.cross(t[1] - t[0], t[2] - t[0]) for t in outer])
    heights = ((inner.reshape(-1, 1, 3) - outer[None, :, 0]) * normals).sum(axis=2)
    return bool((heights <= 0).all())


def test_penetration_of_boxes_is_that_of_their_separating_axes():
    random = np.random.default_rng(3)
    met = 0
    for _ in range(300):
        turns = [about(random.normal(size=3), random.uniform(0, 180)) for _ in range(2)]
        sizes = 10 ** random.uniform(-2, 0, (2, 3))
        first = box(random.uniform(-0.3, 0.3, 3), sizes[0], turns[0])
        second = box(random.uniform(-0.3, 0.3, 3), sizes[1], turns[1])
        found, expected = penetration_m(first, second), separating_axes(first, second)
        if found or not (within(first, second) or within(second, first)):
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)
            met += found > 0
    assert met > 40


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (box((0.9, 0, 0), (1, 1, 1)), 0.1),
        (box((1.0, 0, 0), (1, 1, 1)), 0.0),  # touches
        (box((0, 0, 0), (0.2, 0.2, 0.2)), 0.0),  # inside: surfaces do not meet
        (box((0, 0, 0.55), (3, 3, 0.3)), 0.1),  # a slab over it
        (box((0, 0, 0.5 + math.sqrt(0.5) - 0.25), (1, 1, 1), about((1, 0, 0), 45)), 0.25),
        (box((0, 0, 0.2), (2, 2, 0))[:2] * 0 + box((0, 0, 0.2), (2, 2, 1e-300))[8:10], 0.3),
    ],
)
def test_penetration_into_a_unit_cube(other, expected):
    assert penetration_m(box((0, 0, 0), (1, 1, 1)), other) == pytest.approx(expected, abs=1e-9)


def test_a_part_that_is_not_convex_is_met_as_deep_as_its_triangles():
    blocks = [box((0.5, 0.5, 0.5), 1), box((1.5, 0.5, 0.5), 1), box((0.5, 0.5, 1.5), 1)]
    corner = np.concatenate(blocks)  # an L: its hull would be left after 0.64 m
    for depth in (0.1, 0.05):
        above = box((1.5, 0.5, 1.4 - depth), (0.6, 0.6, 0.8))
        assert penetration_m(corner, above) == pytest.approx(depth, abs=1e-6)
        assert penetration_m(above, corner) == pytest.approx(depth, abs=1e-6)


def test_the_deepest_pair_of_parts_counts_and_a_gap_between_parts_is_none():
    table = np.concatenate(
        [box((0, 0, 0.7), (1, 1, 0.1))]
        + [box((x, y, 0.35), (0.1, 0.1, 0.7)) for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
    )
    assert penetration_m(table, box((0, 0, 0.3), (0.4, 0.4, 0.4))) == 0.0, "stands between the legs"
    assert penetration_m(table, box((0, 0, 0.5), (0.4, 0.4, 0.34))) == pytest.approx(0.02)
    legs = penetration_m(table, box((0.4, 0.4, -0.45), (2, 2, 1)))
    assert legs == pytest.approx(0.05)


FLOOR = box((0, 0, -0.5), (10, 10, 1))


@pytest.mark.parametrize("overhang", [0.0, 0.02, 0.2, 0.4, 0.47, 0.53, 0.6])
def test_a_box_over_an_edge_falls_from_half_on(overhang):
    shelf = box((0, 0, 0.5), (1, 1, 1))
    rest = rest_on(box((overhang, 0, 1.1), (1, 1, 0.2)), shelf)
    assert rest.gap_m == pytest.approx(0.0, abs=1e-12)
    assert rest.balanced == (overhang < 0.5)


@pytest.mark.parametrize("degrees", [0.2, 10, 29, 40])
def test_a_box_on_one_edge_is_not_balanced(degrees):
    turn = about((1, 0, 0), degrees)
    tilted = box((0, 0, 0), (0.5, 0.5, 0.5), turn)
    tilted -= [0, 0, tilted[:, :, 2].min()]
    rest = rest_on(tilted, FLOOR)
    assert rest.gap_m == pytest.approx(0.0, abs=1e-6)
    assert rest.balanced == (degrees < 1), "a corner 2 mm above the floor is in the band"


@pytest.mark.parametrize("z", [-0.5, -0.09, -0.001, 0.0, 0.02, 1.0])
def test_a_box_floats_or_is_sunk_by_its_distance(z):
    ground = box((0, 0, -3), (20, 20, 1))  # another storey below
    below = np.concatenate([box((0, 0, -0.1), (10, 10, 0.2)), ground])
    rest = rest_on(box((0.1, 0.2, 0.5 + z), (0.6, 0.6, 1)), below)
    assert rest.gap_m == pytest.approx(z, abs=1e-12)


def test_thin_legs_and_a_leg_in_the_air():
    legs = [box((x, y, 0.35), (0.01, 0.01, 0.7)) for x in (-0.49, 0.49) for y in (-0.49, 0.49)]
    top = box((0, 0, 0.75), (1, 1, 0.1))
    assert rest_on(np.concatenate([top, *legs]), FLOOR).balanced
    assert rest_on(np.concatenate([top, *legs[1:]]), FLOOR).balanced, "three legs that just hold it"
    fallen = rest_on(np.concatenate([top, *legs[2:]]), FLOOR)
    assert (round(fallen.gap_m, 9), fallen.balanced) == (0, False)


def test_nothing_below():
    assert rest_on(box((20, 0, 1), (1, 1, 1)), FLOOR) is None
    assert rest_on(box((0, 0, -3), (1, 1, 1)), FLOOR) is None, "only above it"


def test_the_centre_of_mass_is_the_volumes():
    both = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((2, 0, 0), (1, 1, 3))])
    assert centre_of_mass(both) == pytest.approx((1.5, 0, 0), abs=1e-12)
    assert centre_of_mass(box((1, 2, 3), (1, 1, 1))[:, ::-1]) == pytest.approx((1, 2, 3))
    sheet = np.array([[(0, 0, 1), (2, 0, 1), (0, 3, 1)]], float)
    assert centre_of_mass(sheet) == pytest.approx((2 / 3, 1, 1))
    smaller = np.array([[(8, 0, 1), (9, 0, 1), (8, 1, 1)]], float)  # a sixth of the first's area
    together = (6 * np.array([2 / 3, 1, 1]) + np.array([25 / 3, 1 / 3, 1])) / 7
    assert centre_of_mass(np.concatenate([sheet, smaller])) == pytest.approx(together)


@pytest.mark.parametrize(
    ("front", "way", "expected"),
    [
        ((0, -1, 0), (0, -5, 0), 0.0),
        ((0, -1, 0), (1e-17, 5, 3), 180.0),
        ((0, -1, 0), (-1e-17, 5, 3), 180.0),
        ((1, 0, 0), (1, 1, 0), 45.0),
        ((1e-8, -1e-9, 1), (1, 0, 0), None),  # lies on its back: rounding would choose
        ((0, -1, 0), (1e-7, -1e-8, 2), None),  # straight above
    ],
)
def test_the_angle_of_a_front(front, way, expected):
    (angle,) = facing_angles_deg(np.array(front), np.array([way]))
    assert angle == expected or (expected is None and math.isnan(angle))


def solid(triangles):
    return Solid(
        points=triangles.reshape(-1, 3), triangles=np.arange(3 * len(triangles)).reshape(-1, 3)
    )


def test_a_closed_solid_encloses_what_the_planes_of_a_box_do():
    random = np.random.default_rng(5)
    turn = about(random.normal(size=3), 40)
    outer = box((0.1, 0.2, 0.3), (1, 2, 3), turn)
    points = random.uniform(-2, 2, (2_000, 3))
    inside = (np.abs((points - (0.1, 0.2, 0.3)) @ turn) <= (0.5, 1, 1.5)).all(axis=1)
    assert solid(outer).closed
    for some in (points[inside], points[~inside], points):
        own = (np.abs((some - (0.1, 0.2, 0.3)) @ turn) <= (0.5, 1, 1.5)).all(axis=1)
        assert solid(outer).share_within(some) == own.mean()
    assert solid(outer).share_within(outer.reshape(-1, 3)) == 1, "its corners are its own"


def test_a_box_without_a_side_or_with_one_turned_around_is_not_closed():
    whole = box((0, 0, 0), (1, 1, 1))
    turned = whole.copy()
    turned[0] = whole[0][::-1]
    assert not solid(whole[1:]).closed
    assert not solid(turned).closed
    assert not solid(whole[:0]).closed
    assert solid(np.concatenate([whole, box((3, 0, 0), (1, 1, 1))])).closed
