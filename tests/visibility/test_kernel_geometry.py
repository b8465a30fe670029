"""Edges, degenerate triangles and hard cameras, by laws and exact counts."""

from __future__ import annotations

import numpy as np
import pytest
from visibility.kernel_scenes import (
    IDENTITY,
    affine,
    mesh,
    pixel_camera,
    pixel_rectangle,
    place,
    rotation,
    sphere,
)

from legoworld.visibility.kernel import coverage, render

AHEAD = np.array([0, 0, 1])


def fan(rng, count, radius):
    """A disc of triangles around an inner point, corners at random angles."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=1) * radius
    centre = rng.uniform(-0.1, 0.1, 2) * radius
    points = np.column_stack([np.vstack([centre, rim]), np.zeros(count + 1)])
    faces = [(0, 1 + i, 1 + (i + 1) % count) for i in range(count)]
    return mesh(points, faces)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_shared_edges_have_no_crack(seed, orthographic):
    rng = np.random.default_rng(seed)
    size_wh = (200, 150)
    camera = pixel_camera(
        size_wh, orthographic=orthographic, fx=90.0, fy=80.0, z_near=1e-3, z_far=1e6
    )
    turn = rotation(rng)
    turn[2] *= 0.3
    disc = place(
        [fan(rng, 300, 400.0)], [(0, affine(turn, rng.normal(size=3) * 0.1 + [0, 0, 500]), 0)]
    )
    seen = render(disc, camera, size_wh)
    inside = seen.instance == 0
    assert inside.sum() > 100
    # A disc is convex: every row of its picture is one run without a hole.
    for row in inside:
        columns = np.flatnonzero(row)
        assert columns.size == 0 or columns[-1] - columns[0] + 1 == columns.size


@pytest.mark.parametrize("seed", range(12))
def test_edges_that_run_through_pixel_centres_have_no_crack(seed):
    # Eight spokes from the middle pixel's centre, along its row, column and diagonals, on a tilted
    # plane: every pixel centre on a spoke lies on a shared edge up to rounding.
    rng = np.random.default_rng(seed)
    size_wh = (101, 101)
    camera = pixel_camera(size_wh)
    slope = rng.uniform(-0.3, 0.3, 2)
    turns = np.arange(8) * np.pi / 4
    ends = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    depths = 5 / (1 - ends @ slope)
    rim = np.column_stack([ends * depths[:, None], depths])
    faces = [(0, 1 + i, 1 + (i + 1) % 8) for i in range(8)]
    surfaces = place([mesh(np.vstack([[(0, 0, 5)], rim]), faces)])
    assert np.all(render(surfaces, camera, size_wh).instance == 0)


@pytest.mark.parametrize("seed", range(6))
def test_a_room_around_the_camera_has_no_hole(seed):
    rng = np.random.default_rng(seed)
    size_wh = (160, 120)
    camera = pixel_camera(size_wh, fx=40.0, fy=40.0, z_near=1e-3)
    inside = rng.uniform(-0.6, 0.6, 3)
    points, faces = sphere(int(rng.integers(5, 40)), int(rng.integers(5, 60)), radius=3.0)
    room = place([mesh(points, faces)], [(0, affine(rotation(rng), inside), 0)])
    assert np.all(render(room, camera, size_wh).instance == 0)


def test_vertices_and_edges_on_pixel_centres_belong_to_the_triangle():
    camera = pixel_camera((40, 40), orthographic=True, fx=1.0, fy=1.0, cx=0.0, cy=0.0)
    square = mesh(
        [(5.5, 5.5, 1), (9.5, 5.5, 1), (9.5, 9.5, 1), (5.5, 9.5, 1)], [(0, 1, 2), (0, 2, 3)]
    )
    expected = np.full((40, 40), -1)
    expected[5:10, 5:10] = 0
    np.testing.assert_array_equal(render(place([square]), camera, (40, 40)).instance, expected)


@pytest.mark.parametrize("size_wh", [(101, 81), (100, 80)])
def test_edge_on_planes_through_the_camera_show_nothing(size_wh):
    camera = pixel_camera(size_wh)
    wall = mesh([(0, -3, 1), (0, 3, 1), (0, 3, 9), (0, -3, 9)], [(0, 1, 2), (0, 2, 3)])
    floor = mesh([(-3, 0, 1), (3, 0, 1), (3, 0, 9), (-3, 0, 9)], [(0, 1, 2), (0, 2, 3)])
    assert np.all(render(place([wall, floor]), camera, size_wh).instance == -1)


@pytest.mark.parametrize("degrees", [17.0, 30.0, 45.0, 73.0])
def test_edge_on_after_a_rotation_that_rounds_shows_nothing(degrees):
    size_wh = (101, 81)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    roll = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    wall = mesh([(0, -3, 1), (0, 3, 1), (0, 3, 9), (0, -3, 9)], [(0, 1, 2), (0, 2, 3)])
    there_and_back = roll.T @ roll
    surfaces = place([wall], [(0, affine(there_and_back, (0, 0, 0)), 0)])
    assert np.all(render(surfaces, pixel_camera(size_wh), size_wh).instance == -1)


def test_triangles_without_area_show_nothing():
    size_wh = (64, 64)
    camera = pixel_camera(size_wh, orthographic=True, fx=1.0, fy=1.0, cx=0.0, cy=0.0)
    points = [(0.5, 0.5, 1), (20.5, 20.5, 1), (40.5, 40.5, 1), (3, 9, 1)]
    faces = [(0, 1, 2), (0, 0, 1), (3, 3, 3), (2, 1, 0), (1, 3, 1)]
    assert np.all(render(place([mesh(points, faces)]), camera, size_wh).instance == -1)
    flattened = place([sphere(6, 8)], [(0, affine(np.zeros((3, 3)), (5, 5, 2)), 0)])
    assert np.all(render(flattened, camera, size_wh).instance == -1)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_the_unit_of_the_scene_does_not_change_the_picture(unit):
    size_wh = (120, 90)
    rng = np.random.default_rng(5)
    at = [(0, affine(rotation(rng), rng.normal(size=3) + AHEAD * 6), i) for i in range(6)]
    camera = pixel_camera(size_wh)
    scaled_camera = pixel_camera(size_wh, z_near=0.1 * unit, z_far=1000 * unit)
    scaled = [(m, c * unit, i) for m, c, i in at]
    plain = render(place([sphere(9, 12)], at), camera, size_wh)
    seen = render(place([sphere(9, 12)], scaled), scaled_camera, size_wh, depth_scale=1 / unit)
    np.testing.assert_array_equal(seen.instance, plain.instance)
    np.testing.assert_allclose(seen.depth_z_m, plain.depth_z_m, rtol=1.3e-7)


def test_a_camera_a_million_units_from_the_origin_sees_the_same():
    size_wh = (120, 90)
    camera = pixel_camera(size_wh)
    offset = np.array([1e6, -1e6, 1e6])
    # Quarter units survive float32 at 1e6, so both meshes are the same shape.
    corners = np.array([(-2, -2, 4), (2.25, -1.75, 5), (1.5, 2, 6), (-1.25, 1.75, 4.5)])
    faces = [(0, 1, 2), (0, 2, 3)]
    near = render(place([mesh(corners, faces)]), camera, size_wh)
    far = render(
        place([mesh(corners + offset, faces)], [(0, affine(np.eye(3), -offset), 0)]),
        camera,
        size_wh,
    )
    assert (near.instance == 0).sum() > 1000
    np.testing.assert_array_equal(far.instance, near.instance)
    np.testing.assert_array_equal(far.depth_z_m, near.depth_z_m)


def test_one_mesh_in_many_placements_is_as_many_copies():
    size_wh = (300, 200)
    camera = pixel_camera(size_wh)
    rng = np.random.default_rng(9)
    at = [affine(rotation(rng) * 0.2, rng.uniform(-3, 3, 3) + AHEAD * 8) for _ in range(500)]
    points, faces = sphere(6, 9)
    shared = render(
        place([(points, faces)], [(0, m, i) for i, m in enumerate(at)]), camera, size_wh
    )
    copies = render(
        place([(points, faces)] * 500, [(i, m, i) for i, m in enumerate(at)]), camera, size_wh
    )
    assert len(np.unique(shared.instance)) > 100
    np.testing.assert_array_equal(shared.instance, copies.instance)
    np.testing.assert_array_equal(shared.depth_z_m, copies.depth_z_m)


@pytest.mark.parametrize("size_wh", [(8192, 3), (3, 8192), (1, 1), (64, 64), (65, 63)])
def test_extreme_picture_sizes_are_filled_to_the_border(size_wh):
    camera = pixel_camera(size_wh)
    width, height = size_wh
    seen = render(place([pixel_rectangle(camera, 0, 0, width, height)]), camera, size_wh)
    assert seen.instance.shape == seen.depth_z_m.shape == (height, width)
    assert np.all(seen.instance == 0)


def test_ids_up_to_the_largest_are_told_apart():
    size_wh = (40, 20)
    camera = pixel_camera(size_wh)
    ids = [2**31 - 2, 70_000, 0]
    boxes = [pixel_rectangle(camera, 10 * i, 0, 10 * i + 10, 20) for i in range(3)]
    surfaces = place(boxes, [(i, IDENTITY, ident) for i, ident in enumerate(ids)])
    assert set(np.unique(render(surfaces, camera, size_wh).instance)) == {-1, *ids}


def test_both_clip_planes_are_part_of_the_view():
    """A surface through both planes, with samples exactly on them: each is still there."""
    size = (16, 4)
    camera = pixel_camera(size, orthographic=True, fx=1.0, fy=1.0, z_near=1.5, z_far=8.5)
    # Planar z is x + 5, so column i has i - 2.5, exactly.
    corners = [(-8, -2, -3), (8, -2, 13), (8, 2, 13), (-8, 2, -3)]
    seen = render(place([mesh(corners, [(0, 1, 2), (0, 2, 3)])]), camera, size)
    expected = np.full(size[::-1], np.inf, np.float32)
    expected[:, 4:12] = np.arange(4, 12) - 2.5
    np.testing.assert_array_equal(seen.depth_z_m, expected)


@pytest.mark.parametrize("z", [1.5, 8.5])
def test_what_lies_wholly_in_a_clip_plane_covers_pixels(z):
    size = (16, 4)
    camera = pixel_camera(size, z_near=1.5, z_far=8.5)
    card = place([pixel_rectangle(camera, 2, 1, 9, 3, z)])
    assert coverage(card, camera, size).tolist() == [5]
    assert (render(card, camera, size).instance == 0).sum() == 14
