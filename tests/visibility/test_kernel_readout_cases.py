"""The kernel's rows of the table of right answers, as exact arrays."""

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
    sphere,
)

from legoworld.visibility.kernel import HOLDOUT, coverage, render

SIZE = (100, 80)
CAMERA = pixel_camera(SIZE)


def box_of(mask):
    """[x, y, width, height] of a mask, pixel edges."""
    rows, columns = np.nonzero(mask)
    x, y = columns.min(), rows.min()
    return [x, y, columns.max() + 1 - x, rows.max() + 1 - y]


def draw_rectangles(*rectangles, size_wh=SIZE, camera=CAMERA):
    return render(place([pixel_rectangle(camera, *r) for r in rectangles]), camera, size_wh)


@pytest.mark.parametrize("size_wh", [(1, 1), (100, 80), (65, 129)])
def test_row_01_a_plane_facing_the_camera_has_one_depth(size_wh):
    camera = pixel_camera(size_wh)
    seen = draw_rectangles((-200, -200, 300, 300), size_wh=size_wh, camera=camera)
    assert np.all(seen.depth_z_m == np.float32(5.0))
    assert np.all(seen.instance == 0)


def test_row_02_inside_a_sphere_depth_is_planar():
    size_wh = (90, 60)
    camera = pixel_camera(size_wh)
    seen = render(place([sphere(400, 800, radius=10.0)]), camera, size_wh)
    x = (np.arange(90) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(60) + 0.5 - camera.cy) / camera.fy
    cosine = 1 / np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    # A facet of a sphere in 400 x 800 lies at most 1 - cos(pi / 400 / 2 * sqrt 2) below it.
    np.testing.assert_allclose(seen.depth_z_m, 10 * cosine, rtol=4e-5)
    assert np.all(seen.depth_z_m <= 10 * cosine * (1 + 1e-6))


@pytest.mark.parametrize("surfaces", [place([]), place([mesh([(0, 0, -5)], [])])])
def test_row_03_nothing_hit_is_infinite_and_minus_one(surfaces):
    seen = render(surfaces, CAMERA, SIZE)
    assert np.all(np.isposinf(seen.depth_z_m))
    assert np.all(seen.instance == -1)


def test_row_04_a_quad_over_columns_and_rows_10_to_49():
    mask = draw_rectangles((10, 10, 50, 50)).instance == 0
    assert mask.sum() == 1600
    assert box_of(mask) == [10, 10, 40, 40]


@pytest.mark.parametrize(("left", "first_column"), [(10.49, 10), (10.51, 11)])
def test_row_05_a_left_edge_decides_by_the_pixel_centre(left, first_column):
    mask = draw_rectangles((left, 20, 40, 30)).instance == 0
    assert box_of(mask)[0] == first_column


@pytest.mark.parametrize(("right", "last_column"), [(30.49, 29), (30.51, 30)])
def test_row_05_a_right_edge_decides_by_the_pixel_centre(right, last_column):
    x, _, width, _ = box_of(draw_rectangles((10, 20, right, 30)).instance == 0)
    assert x + width - 1 == last_column


def test_row_06_the_top_of_the_picture_has_small_y():
    mask = draw_rectangles((30, 2, 40, 8)).instance == 0
    assert box_of(mask) == [30, 2, 10, 6]


def test_row_09_one_pixel_and_a_line_of_one_pixel_are_kept_exactly():
    seen = draw_rectangles((20.4, 30.4, 20.6, 30.6), (10, 50.45, 90, 50.55), (70.45, 5, 70.55, 45))
    assert np.argwhere(seen.instance == 0).tolist() == [[30, 20]]
    assert box_of(seen.instance == 1) == [10, 50, 80, 1]
    assert (seen.instance == 1).sum() == 80
    assert box_of(seen.instance == 2) == [70, 5, 1, 40]
    assert (seen.instance == 2).sum() == 40


def test_row_10_what_shows_nothing_has_its_reason():
    surfaces = place(
        [
            pixel_rectangle(CAMERA, 20.6, 30.6, 21.4, 31.4),  # between four centres
            mesh([(0, 0, -5), (1, 0, -5), (0, 1, -5)], [(0, 1, 2)]),
            pixel_rectangle(CAMERA, 120, 30, 150, 60),
            pixel_rectangle(CAMERA, 40, 40, 50, 50, z=6.0),
            pixel_rectangle(CAMERA, 30, 30, 60, 60, z=5.0),
        ]
    )
    seen = render(surfaces, CAMERA, SIZE)
    assert np.unique(seen.instance).tolist() == [-1, 4]
    assert coverage(surfaces, CAMERA, SIZE).tolist() == [4, 1, 3, 5, 5]


def test_row_11_cut_by_the_border_stays_inside_the_picture():
    seen = draw_rectangles((-40, -40, 12, 9), (90, 70, 500, 500))
    assert box_of(seen.instance == 0) == [0, 0, 12, 9]
    assert box_of(seen.instance == 1) == [90, 70, 10, 10]


def test_row_12_a_surface_outside_the_clip_range_lets_what_is_behind_be_seen():
    camera = pixel_camera(SIZE, z_near=1.0, z_far=9.0)
    surfaces = place(
        [pixel_rectangle(camera, 0, 0, 100, 80, z=z) for z in (0.99, 9.5)]
        + [pixel_rectangle(camera, 10, 10, 50, 50, z=5.0)]
    )
    seen = render(surfaces, camera, SIZE)
    assert (seen.instance == 2).sum() == 1600
    assert np.unique(seen.instance).tolist() == [-1, 2]


@pytest.mark.parametrize("z", [1.0, 9.0])
def test_row_12_both_ends_of_the_clip_range_belong_to_it(z):
    camera = pixel_camera(SIZE, z_near=1.0, z_far=9.0)
    turned = affine(np.eye(3), (0, 0, z))
    flat = mesh([(-9, -9, 0), (9, -9, 0), (0, 18, 0)], [(0, 1, 2)])
    seen = render(place([flat], [(0, turned, 0)]), camera, SIZE)
    assert np.all(seen.depth_z_m == np.float32(z))


def test_row_12_clipping_acts_on_samples_not_on_triangles():
    # A floor 1 below the camera: row r meets it at z = fy / (r + 0.5 - cy).
    camera = pixel_camera(SIZE, z_near=3.0, z_far=20.0)
    floor = mesh(
        [(-1e3, 1, -1e3), (1e3, 1, -1e3), (1e3, 1, 1e3), (-1e3, 1, 1e3)], [(0, 1, 2), (0, 2, 3)]
    )
    seen = render(place([floor]), camera, SIZE)
    below = np.arange(80) + 0.5 - camera.cy
    with np.errstate(divide="ignore"):
        z = np.where(below > 0, camera.fy / below, np.inf)
    expected = np.where((z >= 3) & (z <= 20), z, np.inf).astype(np.float32)
    assert 20 < np.isfinite(expected).sum() < 40
    np.testing.assert_array_equal(seen.depth_z_m, np.repeat(expected[:, None], 100, axis=1))


def test_row_13_masks_are_disjoint_and_fill_the_hit_mask():
    seen = draw_rectangles((10, 10, 60, 60, 5.0), (40, 5, 80, 50, 4.0), (30, 30, 50, 70, 6.0))
    hit = np.isfinite(seen.depth_z_m)
    np.testing.assert_array_equal(seen.instance >= 0, hit)
    areas = [(seen.instance == i).sum() for i in range(3)]
    assert areas[1] == 40 * 45
    assert areas[0] == 50 * 50 - 20 * 40
    assert areas[2] == 20 * 10
    assert sum(areas) == hit.sum()


def test_row_14_of_coplanar_faces_the_lower_id_is_seen():
    for z in (5.0, 0.7, 123.456):
        surfaces = place(
            [
                pixel_rectangle(CAMERA, 10, 10, 50, 50, z),
                pixel_rectangle(CAMERA, 30, 30, 70, 70, z),
            ],
            [(0, IDENTITY, 8), (1, IDENTITY, 3)],
        )
        seen = render(surfaces, CAMERA, SIZE)
        assert (seen.instance == 3).sum() == 1600
        assert (seen.instance == 8).sum() == 1600 - 400


def test_row_14_an_exact_duplicate_placed_otherwise_shows_the_lower_id_only():
    # The same world-space square, once with its size in the mesh, once in the matrix.
    wide = mesh([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [(0, 1, 2), (0, 2, 3)])
    unit = mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 2, 3), (0, 1, 2)])
    tilt = np.array([[0.96, 0.0, 0.28], [0.0, 1.0, 0.0], [-0.28, 0.0, 0.96]])
    surfaces = place(
        [wide, unit], [(0, affine(tilt, (0, 0, 7)), 1), (1, affine(2 * tilt, (0, 0, 7)), 0)]
    )
    seen = render(surfaces, CAMERA, SIZE)
    assert np.unique(seen.instance).tolist() == [-1, 0]


def test_row_14_a_holdout_erases_what_it_hides_and_wins_ties():
    surfaces = place(
        [pixel_rectangle(CAMERA, 10, 10, 50, 50), pixel_rectangle(CAMERA, 20, 20, 30, 30, 4.0)],
        [(0, IDENTITY, 0), (1, IDENTITY, HOLDOUT), (0, IDENTITY, 1)],
    )
    seen = render(surfaces, CAMERA, SIZE)
    assert (seen.instance == 0).sum() == 1600 - 100
    assert np.all(seen.instance[20:30, 20:30] == -1)
    assert np.all(np.isposinf(seen.depth_z_m[20:30, 20:30]))
    same = place(
        [pixel_rectangle(CAMERA, 10, 10, 50, 50)], [(0, IDENTITY, 0), (0, IDENTITY, HOLDOUT)]
    )
    assert np.all(render(same, CAMERA, SIZE).instance == -1)


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1), (-2, 0.5, -3)])
def test_row_27_negative_and_uneven_scales_and_back_faces(scale):
    # The mesh is shrunk by what the placement stretches, so the picture does not change.
    quad, triangles = pixel_rectangle(CAMERA, 10, 20, 50, 40, z=5.0)
    stretch = np.array(scale, float)
    surfaces = place(
        [mesh(quad / stretch, triangles)], [(0, affine(np.diag(stretch), (0, 0, 0)), 0)]
    )
    seen = render(surfaces, CAMERA, SIZE)
    assert box_of(seen.instance == 0) == [10, 20, 40, 20]
    assert (seen.instance == 0).sum() == 800
    np.testing.assert_allclose(seen.depth_z_m[seen.instance == 0], 5.0, rtol=1e-7)


def test_row_30_orthographic_depth_is_along_z():
    camera = pixel_camera(SIZE, orthographic=True, fx=10.0, fy=10.0, z_near=-3.0, z_far=50.0)
    near, far = (
        pixel_rectangle(camera, 10, 10, 50, 50, z=-2.5),
        pixel_rectangle(camera, 30, 30, 70, 70, z=40),
    )
    # z = x over the whole picture: 0.1 per pixel.
    ramp = mesh(
        [(-50, -50, -50), (50, -50, 50), (50, 50, 50), (-50, 50, -50)], [(0, 1, 2), (0, 2, 3)]
    )
    seen = render(place([near, far]), camera, SIZE)
    assert (seen.instance == 0).sum() == 1600
    assert (seen.instance == 1).sum() == 1200
    assert set(np.unique(seen.depth_z_m)) == {np.float32(-2.5), np.float32(40), np.float32(np.inf)}
    slope = render(place([ramp]), camera, SIZE)
    z = (np.arange(100) + 0.5 - 50) / 10
    expected = np.where(z >= -3, z, np.inf)
    np.testing.assert_allclose(slope.depth_z_m, np.broadcast_to(expected, (80, 100)), atol=1e-6)


def test_depth_scale_multiplies_before_rounding():
    camera = pixel_camera(SIZE, z_far=1e5)
    surfaces = place([sphere(20, 30)], [(0, affine(np.eye(3) * 1000, (0, 0, 4000.5)), 0)])
    plain = render(surfaces, camera, SIZE)
    metres = render(surfaces, camera, SIZE, depth_scale=0.001)
    hit = plain.instance == 0
    assert hit.sum() > 100
    np.testing.assert_array_equal(metres.instance, plain.instance)
    expected = plain.depth_z_m[hit].astype(np.float64) * 1e-3
    np.testing.assert_allclose(metres.depth_z_m[hit], expected, rtol=1.2e-7)
    exact = render(place([pixel_rectangle(CAMERA, 0, 0, 100, 80)]), CAMERA, SIZE, depth_scale=0.01)
    assert np.all(exact.depth_z_m == np.float32(np.float64(np.float32(5)) * 0.01))
