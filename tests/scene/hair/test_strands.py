"""Hair and points as meshes: exact widths, declared errors, and how they turn to the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from legoworld.scene.affine import cross, dot, length, unit
from legoworld.scene.hair import strands as strands_module
from legoworld.scene.hair.ribbons import _on_quads, quads, ribbons
from legoworld.scene.hair.spheres import sphere, sphere_error, sphere_levels
from legoworld.scene.hair.strands import (
    TOLERANCE,
    Eye,
    Nodes,
    Strands,
    _basis,
    _basis_slope,
    nodes,
    usable,
)
from legoworld.scene.hair.tubes import _carried_along, _sides, _steps, linear_tubes, round_tubes

#: Looks along +z of the strands' own frame from 10 units before its origin.
TEN_BEFORE = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 10]])
EYE = Eye(cam_from_mesh=TEN_BEFORE, ortho_scale=None)
FLAT_EYE = Eye(cam_from_mesh=TEN_BEFORE, ortho_scale=8.0)
MAKERS = [lambda s, e: ribbons(s, e, 5), round_tubes, linear_tubes]


def strand(points, radius=0.02) -> Strands:
    points = np.array(points, np.float64)
    return usable(points, np.full(len(points), radius), np.array([0, len(points)], np.int64))


def helix(turns=1.0, radius=0.02) -> Strands:
    angles = np.linspace(0, 2 * np.pi * turns, 9)
    return strand(np.c_[np.cos(angles), angles / 4, np.sin(angles)], radius)


def area(mesh) -> float:
    vertices, triangles = mesh
    a, b, c = (vertices[triangles[:, i]].astype(np.float64) for i in range(3))
    return float(length(cross(b - a, c - a)).sum() / 2)


def corners(mesh):
    """All triangles' corners in an order of their own."""
    vertices, triangles = mesh
    rows = vertices[triangles].reshape(-1, 9)
    return rows[np.lexsort(rows.T)]


def test_a_straight_strand_is_one_quad_of_twice_its_radius():
    mesh = ribbons(strand([(0, 0, 0), (0, 3, 0)]), FLAT_EYE, 5)
    assert [len(part) for part in mesh] == [4, 2]
    assert area(mesh) == pytest.approx(3 * 0.04, rel=1e-6)


def test_a_bent_strand_keeps_every_step_and_a_straight_one_only_its_keys():
    straight = strand([(0, y, 0) for y in range(5)])
    assert len(nodes(straight, EYE, 5, True).points) == 5
    assert len(nodes(helix(), EYE, 5, True).points) == 8 * 5 + 1
    assert len(nodes(straight, EYE, 5, False).points) == 4 * 5 + 1


def test_leaving_steps_out_moves_no_edge_by_more_than_the_tolerance():
    bend = [(0.002 * y**2, y / 3, 0) for y in range(8)]
    for scale in np.geomspace(1e-4, 1, 9):
        curve = strand(np.array(bend) * (scale, 1, 1), 0.001)
        whole, some = (nodes(curve, EYE, 5, straighten) for straighten in (False, True))
        along = np.interp(whole.points[:, 1], some.points[:, 1], some.points[:, 0])
        off = np.abs(along - whole.points[:, 0]) / EYE.reach(whole.points)
        assert off.max() <= TOLERANCE


def moved(eye: Eye, rows) -> Eye:
    """The eye of an object that stands by these rows in the present one."""
    whole = np.array([*eye.cam_from_mesh, (0, 0, 0, 1)]) @ np.array([*rows, (0, 0, 0, 1)])
    return replace(eye, cam_from_mesh=whole[:3])


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("unit_", [1e-3, 1e3])
def test_a_surface_does_not_depend_on_the_scene_s_unit(make, flat, unit_):
    eye = Eye(cam_from_mesh=TEN_BEFORE * (1, 1, 1, unit_), ortho_scale=8 * unit_ if flat else None)
    for scale in np.geomspace(1e-4, 1, 5):
        curve = np.array([(0.002 * scale * y**2, y / 3, 0) for y in range(8)])
        one = make(strand(curve, 0.01), FLAT_EYE if flat else EYE)
        other = make(strand(curve * unit_, 0.01 * unit_), eye)
        assert other[0] == pytest.approx(one[0] * unit_, abs=1e-5 * unit_)
        assert np.array_equal(other[1], one[1])


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("eye", [EYE, FLAT_EYE])
def test_a_surface_depends_on_where_a_strand_is_and_not_on_its_object(make, eye):
    """An object moved and scaled, with the strand the other way in it."""
    rows = np.array([[0.5, 0, 0, 3], [0, 0.5, 0, -40], [0, 0, 0.5, 2]])
    for scale in np.geomspace(1e-4, 1, 5):
        curve = np.array([(0.002 * scale * y**2, y / 3, 0) for y in range(8)])
        one = make(strand(curve, 0.01), eye)
        other = make(strand((curve - rows[:, 3]) * 2, 0.02), moved(eye, rows))
        assert other[0] * 0.5 + rows[:, 3] == pytest.approx(one[0], abs=1e-5)
        assert np.array_equal(other[1], one[1])


def test_an_object_s_largest_scale_counts():
    rows = np.diag((1.0, 3.0, 2.0, 1.0))[:3]
    assert moved(EYE, rows).stretch == pytest.approx(3)
    thick, stretched = strand([(0, 0, 0), (0, 1, 0)], 0.03), strand([(0, 0, 0), (0, 1, 0)], 0.01)
    assert _sides(stretched, moved(FLAT_EYE, rows)) == _sides(thick, FLAT_EYE)


def test_a_view_s_share_is_by_distance_or_by_the_view_s_width():
    points = np.zeros((2, 2, 3)) + np.array([0, 0, -10]) + np.arange(4).reshape(2, 2, 1)
    size = np.ones((2, 2))
    away = np.sqrt([[0, 3], [12, 27]])
    assert EYE.reach(points) == pytest.approx(away)
    assert FLAT_EYE.reach(points) == pytest.approx(np.full((2, 2), 8))
    assert EYE.share(points, size)[0, 0] == np.inf
    assert EYE.share(points, size).ravel()[1:] == pytest.approx(1 / away.ravel()[1:])
    made = Eye.of(TEN_BEFORE, 8.0)
    assert made is not None
    assert (made.cam_from_mesh.tolist(), made.ortho_scale) == (TEN_BEFORE.tolist(), 8.0)


def test_rings_along_a_strand_turn_no_more_than_it_does():
    curve = Strands(
        points=np.concatenate([helix().points, helix(0.4).points[:, [1, 2, 0]]]),
        radius=np.full(18, 0.1),
        start=np.array([0, 9, 18]),
    )
    along = nodes(curve, EYE, 6, False)
    across = _carried_along(along)
    assert length(across) == pytest.approx(np.ones(len(across)))
    assert dot(across, along.tangent) == pytest.approx(np.zeros(len(across)), abs=1e-12)
    pairs = along.pairs
    turned = dot(across[pairs], across[pairs + 1])
    assert (turned >= dot(along.tangent[pairs], along.tangent[pairs + 1]) - 1e-12).all()


def test_the_spline_goes_through_its_keys_with_their_radii():
    curve = helix()
    curve = replace(curve, radius=np.linspace(0.1, 0.2, 9))
    along = nodes(curve, EYE, 4, False)
    assert np.array_equal(along.points[::4], curve.points)
    assert np.array_equal(along.radius[::4], curve.radius)
    assert along.last.nonzero()[0].tolist() == [32]


def test_the_spline_is_catmull_and_roms():
    u = np.linspace(0, 1, 11)
    cubes = np.array([[0, -1, 2, -1], [2, 0, -5, 3], [0, 1, 4, -3], [0, 0, -1, 1]]) / 2.0
    powers = np.stack([np.ones_like(u), u, u**2, u**3])
    slopes = np.stack([np.zeros_like(u), np.ones_like(u), 2 * u, 3 * u**2])
    assert np.allclose(_basis(u), cubes @ powers, atol=1e-15)
    assert np.allclose(_basis_slope(u), cubes @ slopes, atol=1e-15)


def test_tangents_are_those_of_the_spline():
    along = nodes(helix(), EYE, 50, False)
    steps = unit(along.points[2:] - along.points[:-2])
    inner = np.arange(50, len(steps) - 50)  # the ends' own slopes are one-sided
    assert np.abs(dot(steps[inner], along.tangent[1:-1][inner]) - 1.0).max() < 1e-4


def test_a_point_of_a_wide_ribbon_lies_on_one_of_its_quads_triangles():
    """A twisted quad: its corners do not lie in a plane."""
    along = Nodes(
        points=np.array([[0.0, 0, 0], [0, 1, 0]]), tangent=unit(np.array([[0.0, 1, 0], [2, 1, 0]])),
        radius=np.array([0.3, 0.2]), last=np.array([False, True]),
    )  # fmt: skip
    ray = FLAT_EYE.toward(along.points)
    across = unit(cross(along.tangent, ray)) * along.radius[:, None]
    (left, left_1), (right, right_1) = along.points + across, along.points - across
    zero, one = np.array([0]), np.array([1])
    for u in (0.0, 0.25, 0.5, 0.75, 1.0):
        for v in (0.0, 0.25, 0.5, 0.75, 1.0):
            (found,) = _on_quads(along, zero, one, np.array([u]), np.array([v]), FLAT_EYE)
            if u + v <= 1:
                expected = (1 - u - v) * left + u * left_1 + v * right
            else:
                expected = (u + v - 1) * right_1 + (1 - u) * right + (1 - v) * left_1
            assert found == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("eye", [EYE, FLAT_EYE])
def test_a_ribbon_faces_the_camera_and_has_the_strands_depth(eye):
    curve = helix()
    along = nodes(curve, eye, 5, True)
    vertices, _ = ribbons(curve, eye, 5)
    left, right = (vertices.reshape(-1, 2, 3)[:, i].astype(np.float64) for i in (0, 1))
    assert np.allclose((left + right) / 2, along.points, atol=1e-6)
    across = unit(left - right)
    assert np.abs(dot(across, unit(eye.toward(along.points)))).max() < 1e-4
    assert np.abs(dot(across, along.tangent)).max() < 1e-4
    assert np.allclose(length(left - right), 0.04, rtol=1e-4)


def test_a_wide_ribbons_points_are_square_to_their_own_ray():
    curve = strand([(0, -1, 0), (0, 1, 0)], 1.0)
    vertices, _ = ribbons(curve, EYE, 5)
    vertices = vertices.astype(np.float64)
    eye_at = np.array([0, 0, -10.0])
    beside = vertices - np.c_[np.zeros(len(vertices)), vertices[:, 1], np.zeros(len(vertices))]
    ray = vertices - eye_at
    flat = np.c_[ray[:, 0], np.zeros(len(ray)), ray[:, 2]]
    assert np.abs(dot(beside, flat)).max() < 2e-3
    assert vertices[:, 2].min() < -0.05  # its edges come nearer


def test_round_tubes_stay_as_close_to_a_cylinder_as_declared():
    vertices, _ = round_tubes(strand([(0, -2, 0), (0, 2, 0)], 0.5), EYE)
    off = np.abs(np.hypot(vertices[:, 0], vertices[:, 2]) - 0.5)
    assert off.max() <= 2e-3 * 0.5  # 64 sides at most
    thin, _ = round_tubes(strand([(0, -2, 0), (0, 2, 0)], 1e-4), EYE)
    assert len(thin) == 2 * 4
    # Four sides: corners as far outside as the sides' middles are inside.
    ring = thin.astype(np.float64)[:4, [0, 2]]
    outside = np.hypot(*ring.T).mean() / 1e-4 - 1
    inside = 1 - np.hypot(*((ring + np.roll(ring, 1, axis=0)) / 2).T).mean() / 1e-4
    assert outside == pytest.approx(inside, rel=1e-3)
    assert outside == pytest.approx(2 / (1 + np.cos(np.pi / 4)) - 1, rel=1e-3)


def test_a_tube_is_whole():
    """All around each piece of a strand, and all of each ball of a linear one."""
    straight = strand([(0, y, 0) for y in (-2, 0, 1, 3)], 0.25)
    walls = 2 * np.pi * 0.25 * 5
    assert area(round_tubes(straight, EYE)) == pytest.approx(walls, rel=2e-3)
    balls = 4 * 4 * np.pi * 0.25**2
    assert area(linear_tubes(straight, EYE)) == pytest.approx(walls + balls, rel=2e-3)
    thin = linear_tubes(strand([(0, 0, 0), (0, 1, 0)], 1e-6), EYE)
    assert len(thin[1]) == 2 * 4 + 2 * 20  # four sides and two icosahedra


def test_a_straight_strand_beside_a_bent_one_has_a_ring_at_each_key_alone():
    bent, straight = helix(), strand([(0, y, 0) for y in range(5)], 0.001)
    both = Strands(
        points=np.concatenate([bent.points, straight.points]),
        radius=np.concatenate([bent.radius, straight.radius]),
        start=np.array([0, 9, 14]),
    )
    more = len(round_tubes(both, EYE)[1]) - len(round_tubes(bent, EYE)[1])
    assert more == 4 * 2 * _sides(both, EYE)


@pytest.mark.parametrize("make", MAKERS)
def test_no_strand_is_no_surface(make):
    none = usable(np.zeros((1, 3)), np.ones(1), np.array([0, 1]))
    assert [part.shape for part in make(none, EYE)] == [(0, 3), (0, 3)]


@pytest.mark.parametrize("share", [1e-6, 1.001e-5, 1e-4, 4e-4, 1e-3, 2e-3, 0.5])
def test_a_ring_has_as_many_sides_as_the_tolerance_asks_for(share):
    sides = _sides(strand([(0, 0, 0), (0, 1, 0)], 8.0 * share), FLAT_EYE)
    enough = [n for n in range(4, 65) if share * (1 - np.cos(np.pi / n)) / 2 <= TOLERANCE]
    assert sides == min(enough, default=64)


def test_linear_tubes_touch_a_sphere_at_each_key():
    curve = replace(strand([(0, 0, 0), (0, 2, 0)]), radius=np.array([0.5, 0.25]))
    vertices, _ = linear_tubes(curve, EYE)
    assert vertices[:, 1].min() == pytest.approx(-0.5, rel=1e-2)
    assert vertices[:, 1].max() == pytest.approx(2.25, rel=1e-2)
    inside = replace(curve, radius=np.array([3.0, 0.25]))  # one sphere holds the other
    assert np.isfinite(linear_tubes(inside, EYE)[0]).all()


@pytest.mark.parametrize("make", MAKERS)
def test_many_strands_are_what_each_is_alone(make, monkeypatch):
    one, other = helix(1.0), helix(0.3)
    both = Strands(
        points=np.concatenate([one.points, other.points]),
        radius=np.concatenate([one.radius, other.radius]),
        start=np.array([0, 9, 18]),
    )
    together = make(both, EYE)
    monkeypatch.setattr(strands_module, "_KEYS_AT_ONCE", 9)
    apart = make(both, EYE)
    assert np.array_equal(corners(together), corners(apart))
    alone = area(make(one, EYE)) + area(make(other, EYE))
    assert area(together) == pytest.approx(alone, rel=1e-3)  # tubes may be finer together


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize(
    "points",
    [
        [(1, 1, 1)] * 4,  # standing still
        [(0, 0, z) for z in range(4)],  # straight away from the camera
        [(0, 0, -10), (0, 1, -10), (0, 2, -9)],  # begins in the camera
        [(0, 0, 0), (0, 1, 0), (0, 0, 0)],  # there and back
    ],
)
def test_odd_strands_give_finite_vertices(make, points):
    vertices, triangles = make(strand(points), EYE)
    assert np.isfinite(vertices).all()
    assert triangles.size == 0 or triangles.max() < len(vertices)


def test_strands_of_one_key_and_negative_radii_are_left_out():
    curve = usable(
        np.arange(12.0).reshape(4, 3), np.array([1.0, -1, -1, 1]), np.array([0, 1, 3, 4])
    )
    assert curve.start.tolist() == [0, 2]
    assert curve.radius.tolist() == [0, 0]


def test_a_quad_is_two_triangles_that_share_a_diagonal():
    left, right, next_left, next_right = (np.array([n, n + 10]) for n in range(4))
    found = quads(left, right, next_left, next_right)
    assert found.dtype == np.int32
    assert found.tolist() == [[0, 2, 1], [3, 1, 2], [10, 12, 11], [13, 11, 12]]


@pytest.mark.parametrize("bend", [0.0, 1e-9, 2e-5, 1e-3, 0.05, 2.0])
def test_a_spline_has_as_many_steps_as_the_tolerance_asks_for(bend):
    """Four times the second difference of the keys, over 8 n^2, of the view's width of 8."""
    points = np.array([(0.0, 0, 0), (bend, 1, 0), (0, 2, 0)])
    share = min(4 * (2 * bend) / 8, 1.0)
    enough = [n for n in range(1, 17) if share <= 8 * TOLERANCE * n * n]
    assert _steps(strand(points), FLAT_EYE) == min(enough, default=16)
    assert _steps(strand(points[:2]), FLAT_EYE) == 1
    # Where one strand ends and the next begins nothing bends.
    straight = np.array([(0.0, y, 0) for y in range(3)])
    both = Strands(
        points=np.concatenate([straight, straight + np.array([5.0, 0, 0])]), radius=np.full(6, 0.1),
        start=np.array([0, 3, 6]),
    )  # fmt: skip
    assert _steps(both, FLAT_EYE) == 1


def test_batches_hold_every_key_once(monkeypatch):
    one = helix()
    three = Strands(
        points=np.concatenate([one.points] * 3), radius=np.arange(27.0),
        start=np.array([0, 9, 18, 27]),
    )  # fmt: skip
    for most, expected in ((1, 3), (9, 3), (10, 2), (18, 2), (19, 1), (100, 1)):
        monkeypatch.setattr(strands_module, "_KEYS_AT_ONCE", most)
        parts = list(three.parts())
        assert len(parts) == expected
        assert np.concatenate([p.radius for p in parts]).tolist() == three.radius.tolist()
        assert np.array_equal(np.concatenate([p.points for p in parts]), three.points)
        assert sum(len(p.start) - 1 for p in parts) == 3
        for part in parts:
            assert part.start.tolist() == list(range(0, len(part.radius) + 1, 9))


def test_the_coarsest_sphere_is_an_icosahedron():
    vertices, triangles = sphere(0)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [0, 2]]])
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    radius = np.linalg.norm(vertices, axis=1)
    assert np.ptp(lengths) < 1e-6
    assert np.ptp(radius) < 1e-6
    assert lengths[0] / radius[0] == pytest.approx(4 / np.sqrt(10 + 2 * np.sqrt(5)), rel=1e-6)


def test_a_flat_transform_has_no_eye():
    assert Eye.of(np.zeros((3, 4)), None) is None


@pytest.mark.parametrize("level", range(5))
def test_spheres_lie_on_both_sides_of_radius_one_alike(level):
    vertices, triangles = sphere(level)
    assert len(triangles) == 20 * 4**level
    assert len(vertices) == 2 + 10 * 4**level  # Euler: closed
    corners = vertices[triangles].astype(np.float64)
    normal = unit(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    inside = np.abs(dot(normal, corners[:, 0])).min()
    assert 1 - inside == pytest.approx(sphere_error(level), rel=1e-3, abs=1e-7)


def test_a_sphere_is_as_fine_as_its_size_asks_for():
    share = np.geomspace(1e-6, 1, 50)
    levels = sphere_levels(share)
    fine = levels < 6
    errors = np.array([sphere_error(level) for level in levels.tolist()])
    assert (share * errors)[fine].max() <= TOLERANCE
    assert (np.diff(levels) >= 0).all()
    assert levels[0] == 0
    assert levels[-1] == 6
