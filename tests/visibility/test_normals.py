"""Normals, towards the camera by each pixel's own ray: of faces, and interpolated."""

from __future__ import annotations

import numpy as np
import pytest
from visibility import oracle
from visibility.kernel_hits import triangles
from visibility.kernel_scenes import (
    HOLDOUT,
    affine,
    ball_pit,
    jumble,
    mesh,
    pixel_camera,
    pixel_rectangle,
    place,
)

from legoworld.errors import ShapeError
from legoworld.visibility.kernel import LEVEL_VARIABLE, LEVELS, render
from legoworld.visibility.normals import render_normals

SIZE = (120, 90)
CAMERA = pixel_camera(SIZE)


def test_a_frontal_wall_looks_at_the_camera_also_in_the_corners():
    wall = pixel_rectangle(CAMERA, 0, 0, 120, 90, 3.0)
    seen = render_normals(place([wall]), CAMERA, SIZE)
    assert np.all(seen.normal_cam == np.array([0, 0, -1], np.float32))
    assert not np.signbit(seen.normal_cam[..., :2]).any()


def test_a_floor_looks_up_and_holes_are_nan():
    corners = [(-50, 1.5, 0.05), (50, 1.5, 0.05), (50, 1.5, 90), (-50, 1.5, 90)]
    seen = render_normals(place([mesh(corners, [(0, 1, 2), (0, 2, 3)])]), CAMERA, SIZE)
    hit = seen.buffers.instance >= 0
    assert hit[60:].all()
    assert np.all(seen.normal_cam[hit] == np.array([0, -1, 0], np.float32))
    assert np.isnan(seen.normal_cam[~hit]).all()


def test_at_wide_angles_a_visible_face_may_look_forward():
    camera = pixel_camera(SIZE, fx=20.0, fy=20.0)  # rays up to 72 degrees to the side
    corners = [(4, -3, 2), (4, 3, 2), (3, 3, 1), (3, -3, 1)]
    leaning = mesh(corners, [(0, 1, 2), (0, 2, 3)])
    seen = render_normals(place([leaning]), camera, SIZE)
    hit = seen.buffers.instance >= 0
    assert hit.sum() > 100
    expected = np.array([-1, 0, 1]) / np.sqrt(2)
    np.testing.assert_allclose(seen.normal_cam[hit], expected[None].repeat(hit.sum(), 0), atol=1e-7)


@pytest.mark.parametrize("seed", range(12))
def test_normals_are_the_inverse_transposes_and_look_at_the_camera(seed):
    surfaces, camera, size_wh = jumble(seed)
    seen = render_normals(surfaces, camera, size_wh)
    hits = triangles(surfaces, camera, size_wh)
    plain = render(surfaces, camera, size_wh)
    assert seen.buffers.instance.tobytes() == plain.instance.tobytes()
    assert seen.buffers.depth_z_m.tobytes() == plain.depth_z_m.tobytes()
    shown = hits.triangle >= 0
    np.testing.assert_array_equal(np.isnan(seen.normal_cam).any(axis=-1), ~shown)
    directions = oracle.rays(camera, size_wh)[1][shown].astype(float)
    normals, flipped = [], 0
    for (placement, triangle), ray in zip(
        np.stack([hits.placement[shown], hits.triangle[shown]], axis=1), directions, strict=True
    ):
        number = surfaces.placement_mesh[placement]
        start = surfaces.triangle_start[number]
        index = surfaces.triangles[start + triangle]
        a, b, c = surfaces.vertices[surfaces.vertex_start[number] + index].astype(float)
        inverse = np.linalg.inv(surfaces.cam_from_mesh[placement][:, :3])
        front = inverse.T @ np.cross(b - a, c - a)
        flipped += front @ ray > 0
        normals.append((-front if front @ ray > 0 else front) / np.linalg.norm(front))
    found = seen.normal_cam[shown]
    np.testing.assert_allclose(found, np.array(normals), atol=2e-6)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1, atol=2e-7)
    assert np.einsum("ij,ij->i", found, directions).max() <= 1e-6
    assert seen.flipped_share == pytest.approx(flipped / shown.sum(), abs=1e-12)
    assert 0 < seen.flipped_share < 1


def assert_same_normals(one, other):
    assert one.normal_cam.tobytes() == other.normal_cam.tobytes()
    assert one.flipped_share == other.flipped_share


@pytest.mark.parametrize("seed", range(3))
def test_same_bytes_for_threads_and_instruction_sets(seed, monkeypatch):
    surfaces, camera, size_wh = jumble(seed)
    first = render_normals(surfaces, camera, size_wh, threads=1)
    for threads in (2, 4):
        assert_same_normals(render_normals(surfaces, camera, size_wh, threads=threads), first)
    for level in LEVELS:
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        assert_same_normals(render_normals(surfaces, camera, size_wh, threads=2), first)


def test_small_triangles_drawn_in_many_rounds():
    surfaces, size_wh = ball_pit(60), (200, 150)
    camera = pixel_camera(size_wh)
    seen = render_normals(surfaces, camera, size_wh)
    hits = triangles(surfaces, camera, size_wh)
    shown = hits.triangle >= 0
    assert seen.buffers.depth_z_m.tobytes() == hits.buffers.depth_z_m.tobytes()
    a, b, c = np.moveaxis(oracle.corners_of(hits, surfaces, shown).astype(float), 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rays = oracle.rays(camera, size_wh)[1][shown].astype(float)
    normals *= -np.sign(np.einsum("ij,ij->i", normals, rays))[:, None]
    np.testing.assert_allclose(seen.normal_cam[shown], normals, atol=1e-6)
    assert seen.flipped_share in (0.0, 1.0)  # closed balls show one side


def test_the_share_flipped_counts_backs_and_a_mirror_turns_nothing():
    vertices, triangles = pixel_rectangle(CAMERA, 20, 10, 100, 50)
    card, turned = (vertices, triangles), (vertices, triangles[:, ::-1].copy())
    mirror = affine(np.diag([-1.0, 1, 1]), (0, 0, 0))
    still = affine(np.eye(3), (0, 0, 0))
    shares = {}
    for name, shape in (("card", card), ("turned", turned)):
        for how, matrix in (("still", still), ("mirrored", mirror)):
            surfaces = place([shape], [(0, matrix, 0)])
            shares[name, how] = render_normals(surfaces, CAMERA, SIZE).flipped_share
    assert shares["card", "still"] == shares["card", "mirrored"]
    assert shares["turned", "still"] == shares["turned", "mirrored"]
    assert {shares["card", "still"], shares["turned", "still"]} == {0.0, 1.0}


def test_nothing_and_holdouts_have_no_normals():
    card = pixel_rectangle(CAMERA, 20, 10, 100, 50)
    seen = render_normals(place([card], [(0, np.eye(4)[:3], HOLDOUT)]), CAMERA, SIZE)
    assert np.isnan(seen.normal_cam).all()
    assert np.isnan(seen.flipped_share)


def corner_normals(surfaces, seed=0):
    """Of every triangle: its own plus noise, of any length; a third of them are flat."""
    noise = np.random.default_rng(seed)
    normals = np.empty((len(surfaces.triangles), 3, 3), np.float32)
    for m, start in enumerate(surfaces.triangle_start[:-1]):
        index = surfaces.triangles[start : surfaces.triangle_start[m + 1]]
        a, b, c = np.moveaxis(surfaces.vertices[surfaces.vertex_start[m] + index], 1, 0)
        face = np.cross(b - a, c - a)
        face /= np.linalg.norm(face, axis=-1, keepdims=True) + 1e-30
        normals[start : start + len(index)] = face[:, None] + noise.normal(
            0, 0.4, (len(index), 3, 3)
        )
    normals *= noise.uniform(0.1, 5, (len(normals), 3, 1))
    normals[noise.random(len(normals)) < 0.3, 1] = 0
    return np.ascontiguousarray(normals, np.float32)


@pytest.mark.parametrize("seed", range(6))
def test_shading_normals_are_those_of_the_corners_interpolated(seed):
    """Placements of a jumble are turned, sheared and mirrored; numpy knows them by the inverse."""
    surfaces, camera, size_wh = jumble(seed)
    corners = corner_normals(surfaces, seed)
    flat = render_normals(surfaces, camera, size_wh)
    seen = render_normals(surfaces, camera, size_wh, corner_normals=corners)
    hits = triangles(surfaces, camera, size_wh, barycentric=True)
    assert seen.buffers.depth_z_m.tobytes() == flat.buffers.depth_z_m.tobytes()
    assert (seen.variant, flat.variant) == ("shading", "geometric")
    assert seen.flipped_share == flat.flipped_share
    smooth = 0
    for row, column in np.argwhere(hits.triangle >= 0):
        placement = hits.placement[row, column]
        start = surfaces.triangle_start[surfaces.placement_mesh[placement]]
        own = corners[start + hits.triangle[row, column]].astype(float)
        face = flat.normal_cam[row, column].astype(float)
        found = seen.normal_cam[row, column]
        if not own[1].any():
            assert found.tobytes() == flat.normal_cam[row, column].tobytes()
            continue
        smooth += 1
        inverse = np.linalg.inv(surfaces.cam_from_mesh[placement][:, :3])
        moved = own @ inverse
        moved /= np.linalg.norm(moved, axis=-1, keepdims=True)
        w1, w2 = hits.barycentric[row, column].astype(float)
        # Two that differ by the determinant's sign: the face says which it is.
        expected = (1 - w1 - w2) * moved[0] + w1 * moved[1] + w2 * moved[2]
        expected *= np.sign(expected @ face) / np.linalg.norm(expected)
        assert found @ face >= 0
        np.testing.assert_allclose(found, expected, atol=2e-6)
    assert smooth > 300


@pytest.mark.parametrize("broken", [0.0, np.nan, np.inf])
def test_without_normals_at_a_corner_both_variants_are_the_same_bits(broken):
    surfaces, camera, size_wh = jumble(1)
    corners = corner_normals(surfaces)
    corners[:, 2] = broken
    seen = render_normals(surfaces, camera, size_wh, corner_normals=corners)
    assert_same_normals(seen, render_normals(surfaces, camera, size_wh))


def test_shading_normals_have_the_same_bytes_for_threads_and_instruction_sets(monkeypatch):
    surfaces, camera, size_wh = jumble(2)
    corners = corner_normals(surfaces)
    first = render_normals(surfaces, camera, size_wh, corner_normals=corners, threads=1)
    for level in LEVELS:
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        again = render_normals(surfaces, camera, size_wh, corner_normals=corners, threads=3)
        assert_same_normals(again, first)


def test_corner_normals_of_another_shape_or_type_are_refused():
    surfaces, camera, size_wh = jumble(0)
    good = corner_normals(surfaces)
    for bad in (good[1:], good.astype(np.float64), good[..., ::-1], good[:, 0]):
        with pytest.raises(ShapeError, match="corner_normals"):
            render_normals(surfaces, camera, size_wh, corner_normals=bad)
