"""The kernel against the brute-force oracle, on random scenes."""

from __future__ import annotations

import numpy as np
import pytest
from visibility import oracle
from visibility.kernel_scenes import affine, mesh, pixel_camera, place, rotation

from legoworld.visibility.kernel import HOLDOUT, render

HALF_ULP = 2.0**-24 * (1 + 1e-6)  # relative error of rounding to float32


def soup(rng, count, spread, size):
    """Loose triangles around a point in front of the camera."""
    centre = rng.normal(size=(count, 1, 3)) * spread + [0, 0, 5]
    return mesh(centre + rng.normal(size=(count, 3, 3)) * size, np.arange(3 * count))


def strips(rng, count):
    """Slivers between two rims, passing the camera: a three-thousandth as wide as long."""
    across = np.linspace(-1, 1, count + 1)
    rims = [
        np.column_stack([across, np.full(count + 1, 0.7), np.full(count + 1, z)]) for z in (-8, 30)
    ]
    low, high = np.arange(count), np.arange(count) + count + 1
    faces = np.concatenate(
        [np.stack([low, high, high + 1], 1), np.stack([low, high + 1, low + 1], 1)]
    )
    return mesh(np.concatenate(rims), faces)


def agree(surfaces, camera, size_wh, **options):
    seen = render(surfaces, camera, size_wh, **options)
    truth = oracle.render(surfaces, camera, size_wh, **options)
    sure = ~truth.doubtful
    np.testing.assert_array_equal(seen.instance[sure], truth.instance[sure])
    same = seen.instance == truth.instance
    hit = same & (seen.instance >= 0)
    error = np.abs(seen.depth_z_m[hit] / truth.depth_z_m[hit] - 1)
    assert error.max(initial=0) <= HALF_ULP
    np.testing.assert_array_equal(np.isposinf(seen.depth_z_m), seen.instance < 0)
    return seen, truth


@pytest.mark.parametrize("seed", range(40))
def test_random_triangles(seed):
    rng = np.random.default_rng(seed)
    size_wh = (int(rng.integers(1, 110)), int(rng.integers(1, 90)))
    orthographic = seed % 3 == 0
    focal = rng.uniform(5, 25) if orthographic else rng.uniform(30, 200)
    camera = pixel_camera(
        size_wh,
        orthographic=orthographic,
        fx=focal,
        fy=focal * rng.uniform(0.8, 1.2),
        cx=size_wh[0] / 2 + rng.normal(),
        cy=size_wh[1] / 2 + rng.normal(),
        z_near=float(rng.choice([0.01, 3.0])),
        z_far=float(rng.choice([6.0, 1000.0])),
    )
    meshes = [
        soup(rng, int(rng.integers(1, 16)), rng.choice([1, 4]), rng.choice([0.05, 1, 5, 50]))
        for _ in range(3)
    ]
    at = [
        (
            int(rng.integers(3)),
            affine(rotation(rng) @ np.diag(rng.normal(size=3)), rng.normal(size=3)),
            i,
        )
        for i in (HOLDOUT, 0, 1, 2, 2)
    ]
    _, truth = agree(place(meshes, at), camera, size_wh)
    assert truth.doubtful.mean() < 0.02


@pytest.mark.parametrize("seed", range(4))
def test_slivers_through_the_near_plane(seed):
    rng = np.random.default_rng(seed)
    size_wh = (61, 47)
    camera = pixel_camera(size_wh, fx=50.0 + rng.random(), fy=50.0, cx=30.2, z_near=0.05)
    roll = affine(rotation(np.random.default_rng(100 + seed)), (0, 0, 0))
    seen, truth = agree(
        place([strips(rng, 150)], [(0, affine(np.eye(3), (0.01, 0, 0)), 0), (0, roll, 1)]),
        camera,
        size_wh,
    )
    assert (seen.instance >= 0).sum() > 300
    assert truth.doubtful.mean() < 0.02


@pytest.mark.parametrize("seed", range(4))
def test_huge_triangles_far_from_the_origin(seed):
    rng = np.random.default_rng(seed)
    size_wh = (70, 50)
    camera = pixel_camera(size_wh, z_near=0.1, z_far=1e7)
    big = mesh(rng.normal(size=(30, 3)) * 1e6, np.arange(30))
    seen, _ = agree(place([big, soup(rng, 10, 2, 1)]), camera, size_wh)
    assert (seen.instance == 0).sum() > 100


@pytest.mark.parametrize("depth_scale", [0.001, 0.3048, 1000.0])
def test_depth_scale(depth_scale):
    rng = np.random.default_rng(11)
    size_wh = (60, 40)
    agree(place([soup(rng, 30, 2, 2)]), pixel_camera(size_wh), size_wh, depth_scale=depth_scale)


def test_the_oracle_itself_knows_a_square_and_a_slope():
    camera = pixel_camera((20, 10), orthographic=True, fx=1.0, fy=1.0, cx=0.0, cy=0.0)
    slope = mesh([(2, 2, 2), (8, 2, 8), (8, 6, 8), (2, 6, 2)], [(0, 1, 2), (0, 2, 3)])
    truth = oracle.render(place([slope]), camera, (20, 10))
    expected = np.full((10, 20), np.inf)
    expected[2:6, 2:8] = np.arange(2, 8) + 0.5
    np.testing.assert_allclose(truth.depth_z_m.astype(float), expected, rtol=1e-12)
