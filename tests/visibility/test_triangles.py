"""The triangle of each pixel, and where on it the pixel's ray hits."""

from __future__ import annotations

import numpy as np
import pytest
from visibility import oracle
from visibility.kernel_hits import triangles
from visibility.kernel_scenes import ball_pit, jumble, mesh, pixel_camera, pixel_rectangle, place

from legoworld.visibility.kernel import LEVEL_VARIABLE, LEVELS, render

SIZE = (120, 90)
CAMERA = pixel_camera(SIZE)


def bytes_of(hits):
    arrays = (hits.buffers.instance, hits.buffers.depth_z_m, hits.placement, hits.triangle)
    return b"".join(a.tobytes() for a in (*arrays, hits.barycentric) if a is not None)


def assert_same_picture(hits, seen):
    assert hits.buffers.instance.tobytes() == seen.instance.tobytes()
    assert hits.buffers.depth_z_m.tobytes() == seen.depth_z_m.tobytes()
    np.testing.assert_array_equal(hits.triangle < 0, seen.instance < 0)
    np.testing.assert_array_equal(hits.placement < 0, seen.instance < 0)


@pytest.mark.parametrize("seed", range(12))
def test_triangles_and_weights_are_the_oracles(seed):
    surfaces, camera, size_wh = jumble(seed)
    hits = triangles(surfaces, camera, size_wh, barycentric=True)
    assert_same_picture(hits, render(surfaces, camera, size_wh))
    truth = oracle.render(surfaces, camera, size_wh)
    # Ids 0 and 7 tie everywhere, which the oracle calls doubtful: there both take the lower id.
    same = (hits.buffers.instance == truth.instance) & (truth.instance >= 0)
    sure = same & (~truth.doubtful | (truth.instance == 0))
    agree = (hits.placement == truth.placement) & (hits.triangle == truth.triangle)
    assert agree[sure & ~truth.doubtful].all()
    assert agree[sure].mean() > 0.99
    weights = truth.weights[sure & agree][:, 1:].astype(float)
    np.testing.assert_allclose(hits.barycentric[sure & agree], weights, atol=2e-7)
    assert np.isnan(hits.barycentric[hits.triangle < 0]).all()
    assert sure.sum() > 100


@pytest.mark.parametrize("seed", range(3))
def test_same_bytes_for_threads_and_instruction_sets(seed, monkeypatch):
    surfaces, camera, size_wh = jumble(seed)
    more = {"barycentric": True}
    first = bytes_of(triangles(surfaces, camera, size_wh, threads=1, **more))
    for threads in (2, 4):
        assert bytes_of(triangles(surfaces, camera, size_wh, threads=threads, **more)) == first
    for level in LEVELS:
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        assert bytes_of(triangles(surfaces, camera, size_wh, threads=2, **more)) == first


def test_small_triangles_drawn_in_many_rounds():
    surfaces, size_wh = ball_pit(60), (200, 150)
    camera = pixel_camera(size_wh)
    hits = triangles(surfaces, camera, size_wh, barycentric=True)
    assert_same_picture(hits, render(surfaces, camera, size_wh))
    shown = hits.triangle >= 0
    corners = oracle.corners_of(hits, surfaces, shown).astype(float)
    w1, w2 = hits.barycentric[shown].astype(float).T
    assert min(w1.min(), w2.min(), (1 - w1 - w2).min()) > -1e-6
    points = np.einsum("nk,nkj->nj", np.column_stack([1 - w1 - w2, w1, w2]), corners)
    np.testing.assert_allclose(points[:, 2], hits.buffers.depth_z_m[shown], rtol=1e-6)
    rows, columns = np.nonzero(shown)
    np.testing.assert_allclose(
        camera.cx + camera.fx * points[:, 0] / points[:, 2], columns + 0.5, atol=1e-4
    )
    np.testing.assert_allclose(
        camera.cy + camera.fy * points[:, 1] / points[:, 2], rows + 0.5, atol=1e-4
    )
    assert shown.sum() > 5000


@pytest.mark.parametrize("side", [1.5, 40.0])  # below 2 x 2 pixel centres, and far above
def test_of_coplanar_triangles_of_one_instance_the_lowest_is_taken(side):
    spots = [(10.2, 10.2), (30.2, 20.2), (60.2, 40.2)]
    points = [(u + du, v + dv) for u, v in spots for du, dv in ((0, 0), (side, 0), (0, side))]
    vertices = [((u - 60) / 100 * 4, (v - 45) / 100 * 4, 4.0) for u, v in points]
    once = np.arange(9).reshape(3, 3)
    stack = mesh(vertices, np.concatenate([once[::-1], once, once]))
    twice = place([stack], [(0, np.eye(4)[:3], 4), (0, np.eye(4)[:3], 4)])
    hits = triangles(twice, CAMERA, SIZE)
    shown = hits.triangle[hits.triangle >= 0]
    assert set(np.unique(shown)) == {0, 1, 2}
    assert (hits.placement[hits.triangle >= 0] == 0).all()
    for threads in (1, 2, 4):
        assert bytes_of(triangles(twice, CAMERA, SIZE, threads=threads)) == bytes_of(hits)


def test_triangles_are_local_to_the_placements_mesh():
    meshes = [
        pixel_rectangle(CAMERA, 0, 0, 50, 90, 5.0),
        pixel_rectangle(CAMERA, 60, 0, 120, 90, 5.0),
    ]
    still = np.eye(4)[:3]
    hits = triangles(place(meshes, [(1, still, 8), (0, still, 3)]), CAMERA, SIZE)
    assert (hits.placement[:, :50] == 1).all()
    assert (hits.placement[:, 50:60] == -1).all()
    assert (hits.placement[:, 60:] == 0).all()
    assert set(np.unique(hits.triangle)) == {-1, 0, 1}
    assert hits.barycentric is None
