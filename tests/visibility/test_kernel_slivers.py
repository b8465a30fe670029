"""Triangles that are long, thin, flat or far to one side: what spans of columns are found for."""

from __future__ import annotations

import numpy as np
import pytest
from visibility import oracle
from visibility.kernel_scenes import affine, mesh, pixel_camera, place, rotation

from legoworld.visibility.kernel import LEVEL_VARIABLE, LEVELS, Cutouts, render

SIZE = (90, 150)  # two tiles across, three down: a sliver passes whole tiles from top to bottom
CAMERA = pixel_camera(SIZE, cx=44.7, cy=75.2)


def on_screen(camera, uvz):
    """Points (N, 3) of the camera's frame at pixel coordinates u, v and depth z."""
    u, v, z = np.asarray(uvz, float).T
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    return np.column_stack([x * z, y * z, z])


def needles(rng, camera, count, width_px):
    """Triangles from above the picture to below it, up to `width_px` wide, leaning any way."""
    width, height = SIZE
    top, bottom = rng.uniform(-20, width + 20, size=(2, count))
    wide = rng.uniform(0.05, width_px, size=count)
    z = rng.uniform(2, 9, size=(3, count))
    low, high = np.full(count, -5.0), np.full(count, height + 5.0)
    corners = np.stack([(top, low, z[0]), (bottom, high, z[1]), (bottom + wide, high, z[2])])
    points = corners.transpose(2, 0, 1).reshape(-1, 3)
    return mesh(on_screen(camera, points), np.arange(3 * count))


def agree(surfaces, camera=CAMERA, size_wh=SIZE):
    """The kernel's picture, found to be the oracle's where rounding does not decide."""
    seen = render(surfaces, camera, size_wh)
    truth = oracle.render(surfaces, camera, size_wh)
    sure = ~truth.doubtful
    assert sure.mean() > 0.98
    np.testing.assert_array_equal(seen.instance[sure], truth.instance[sure])
    hit = sure & (seen.instance >= 0)
    error = np.abs(seen.depth_z_m[hit] / truth.depth_z_m[hit] - 1)
    assert error.max(initial=0) <= 2.0**-24 * (1 + 1e-6)
    return seen


@pytest.mark.parametrize("level", ["", *LEVELS])
@pytest.mark.parametrize("width_px", [1.0, 4.0, 12.0])
@pytest.mark.parametrize("orthographic", [False, True])
def test_tall_needles(width_px, orthographic, level, monkeypatch):
    monkeypatch.setenv(LEVEL_VARIABLE, level)
    rng = np.random.default_rng(int(width_px))
    camera = pixel_camera(SIZE, orthographic=orthographic, cx=44.7, cy=75.2)
    parts = [needles(rng, CAMERA, 40, width_px) for _ in range(2)]
    if orthographic:
        parts = [(points * np.float32(0.2), faces) for points, faces in parts]
    seen = agree(place(parts), camera)
    assert (seen.instance >= 0).sum() > 500


@pytest.mark.parametrize("seed", range(3))
def test_tall_needles_with_holes(seed):
    rng = np.random.default_rng(seed)
    count = 60
    cutouts = Cutouts(
        triangle_cutout=rng.integers(-1, 1, count).astype(np.int32),
        corner_uv=rng.uniform(0, 6, size=(count, 3, 2)).astype(np.float32),
        alphas=(np.array([[255, 0], [0, 255]], np.uint8),),
        wrap=("repeat",),
        interpolation=("closest",),
        sides=("both",),
        threshold=0.5,
    )
    solid = place([needles(rng, CAMERA, count, 3.0)])
    cut = place([(solid.vertices, solid.triangles)], cutouts=cutouts)
    seen = agree(cut)
    whole = render(solid, CAMERA, SIZE)
    assert 200 < (seen.instance >= 0).sum() < (whole.instance >= 0).sum()


@pytest.mark.parametrize("seed", range(4))
def test_needles_through_the_near_plane(seed):
    rng = np.random.default_rng(seed)
    points, faces = needles(rng, CAMERA, 60, 3.0)
    points[::3] *= np.float32(0.2)  # the tip keeps its pixel and comes nearer than z_near
    camera = pixel_camera(SIZE, cx=44.7, cy=75.2, z_near=1.5, z_far=7.0)
    seen = agree(place([(points, faces)]), camera)
    whole = render(place([(points, faces)]), CAMERA, SIZE)
    assert 100 < (seen.instance >= 0).sum() < (whole.instance >= 0).sum()


@pytest.mark.parametrize("turned", [False, True], ids=["exact", "rounded"])
def test_triangles_without_area_show_nothing_and_hide_nothing(turned):
    rng = np.random.default_rng(5)
    start, step = np.array([-2.0, -1.0, -3.0]), np.array([0.125, 0.0625, 0.5])
    at = rng.integers(0, 40, size=(300, 3))
    lines = mesh((start + at.reshape(-1, 1) * step), np.arange(900))
    matrix = affine(rotation(rng) if turned else np.eye(3), (0.1, 0.2, 2.0))
    wall = needles(rng, CAMERA, 80, 12.0)
    alone = render(place([lines], [(0, matrix, 0)]), CAMERA, SIZE)
    assert (alone.instance == -1).all()
    both = render(place([wall, lines], [(0, np.eye(3, 4), 0), (1, matrix, 1)]), CAMERA, SIZE)
    only = render(place([wall]), CAMERA, SIZE)
    assert both.instance.tobytes() == only.instance.tobytes()
    assert both.depth_z_m.tobytes() == only.depth_z_m.tobytes()


@pytest.mark.parametrize("shift", [-1e6, 1e5, 1e6])
def test_needles_far_beside_the_optical_axis(shift):
    rng = np.random.default_rng(9)
    camera = pixel_camera(SIZE, fx=1e6, fy=1e6, cx=shift, cy=-shift / 3, z_near=1e-3)
    seen = agree(place([needles(rng, camera, 60, 6.0)]), camera)
    assert (seen.instance >= 0).sum() > 100
