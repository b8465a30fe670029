"""Image alpha in the kernel, against a numpy sampling of the same images."""

from __future__ import annotations

import numpy as np
import pytest
from visibility import oracle
from visibility.kernel_scenes import (
    IDENTITY,
    affine,
    mesh,
    pixel_camera,
    pixel_rectangle,
    place,
    rotation,
)

from legoworld.visibility.kernel import Cutouts, coverage, render

SIZE = (120, 90)
CAMERA = pixel_camera(SIZE)
QUAD_UV = np.array([[(0, 1), (1, 1), (1, 0)], [(0, 1), (1, 0), (0, 0)]], np.float32)


def cut(alpha, corner_uv, wrap="repeat", interpolation="closest", threshold=0.5, indices=None,
        sides="both", corner_alpha=None):  # fmt: skip
    faces = len(corner_uv)
    return Cutouts(
        triangle_cutout=np.zeros(faces, np.int32)
        if indices is None
        else np.array(indices, np.int32),
        corner_uv=np.asarray(corner_uv, np.float32),
        alphas=(np.asarray(alpha, np.uint8),),
        wrap=(wrap,),
        interpolation=(interpolation,),
        sides=(sides,),
        corner_alpha=None if corner_alpha is None else np.asarray(corner_alpha, np.float32),
        threshold=threshold,
    )


def test_row_0_of_the_image_is_the_top_and_column_0_the_left():
    alpha = np.zeros((4, 8), np.uint8)
    alpha[0, 0] = alpha[3, 7] = alpha[1, 2] = 255
    card = pixel_rectangle(CAMERA, 20, 10, 100, 50)  # 10 pixels a texel
    seen = render(place([card], cutouts=cut(alpha, QUAD_UV)), CAMERA, SIZE)
    expected = np.full((90, 120), -1)
    expected[10:50, 20:100] = np.where(np.kron(alpha, np.ones((10, 10))) > 0, 0, -1)
    np.testing.assert_array_equal(seen.instance, expected)


def test_what_lies_behind_a_hole_is_seen():
    alpha = np.array([[255, 0]], np.uint8)
    card, wall = (
        pixel_rectangle(CAMERA, 20, 10, 100, 50, 4.0),
        pixel_rectangle(CAMERA, 0, 0, 120, 90, 6.0),
    )
    uv = np.concatenate([QUAD_UV, QUAD_UV * 0])
    seen = render(place([card, wall], cutouts=cut(alpha, uv, indices=[0, 0, -1, -1])), CAMERA, SIZE)
    assert (seen.instance == 0).sum() == 40 * 40
    assert (seen.instance == 1).sum() == 120 * 90 - 40 * 40
    assert np.all(seen.depth_z_m[10:50, 60:100] == 6)


@pytest.mark.parametrize(("value", "there"), [(127, False), (128, True), (255, True), (0, False)])
def test_the_threshold_is_alpha_over_255(value, there):
    card = pixel_rectangle(CAMERA, 20, 10, 100, 50)
    seen = render(place([card], cutouts=cut([[value]], QUAD_UV)), CAMERA, SIZE)
    assert (seen.instance == 0).any() == there
    exact = render(
        place([card], cutouts=cut([[value]], QUAD_UV, threshold=value / 255)), CAMERA, SIZE
    )
    assert (exact.instance == 0).sum() == 3200


@pytest.mark.parametrize("interpolation", ["closest", "linear"])
@pytest.mark.parametrize("wrap", ["repeat", "extend", "clip", "mirror"])
@pytest.mark.parametrize("seed", range(3))
def test_every_wrap_and_interpolation_in_perspective(wrap, interpolation, seed):
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(2, 6)), int(rng.integers(2, 9)))
    alpha = rng.integers(0, 256, size=shape, dtype=np.uint8)
    alpha[0, 0], alpha[-1, -1] = 0, 255
    corners = np.array([(-4, -3, 0), (4, -3, 0), (4, 3, 0), (-4, 3, 0)], float)
    card = mesh(corners, [(0, 1, 2), (0, 2, 3)])
    uv = 0.5 + corners[:, :2] / [8, -6] * rng.uniform(2, 4, 2)  # well beyond 0..1
    corner_uv = uv[[[0, 1, 2], [0, 2, 3]]]
    turn = rotation(rng)
    turn = turn if abs(turn[2, 2]) > 0.3 else np.eye(3)
    surfaces = place(
        [card],
        [(0, affine(turn, (0.1, 0.2, 6.0)), 0)],
        cutouts=cut(alpha, corner_uv, wrap, interpolation),
    )
    seen = render(surfaces, CAMERA, SIZE)
    truth = oracle.render(surfaces, CAMERA, SIZE)
    # Texel borders are decided by rounding just as edges are; they are met by chance only.
    wrong = (seen.instance != truth.instance) & ~truth.doubtful
    assert wrong.sum() == 0
    solid = render(place([card], [(0, surfaces.cam_from_mesh[0], 0)]), CAMERA, SIZE)
    assert 0 < (seen.instance == 0).sum() < (solid.instance == 0).sum()


def test_small_triangles_are_cut_too():
    rng = np.random.default_rng(3)
    side = 60
    grid = np.stack(np.meshgrid(np.arange(side + 1), np.arange(side + 1)), -1).reshape(-1, 2) / side
    a = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + side + 2], 1), np.stack([a, a + side + 2, a + side + 1], 1)]
    )
    points = np.column_stack([(grid - 0.5) * [3, -2], 5 + grid[:, 0]])
    alpha = rng.integers(0, 2, size=(7, 9), dtype=np.uint8) * 255
    cutouts = cut(alpha, grid[faces])
    surfaces = place([mesh(points, faces)], cutouts=cutouts)
    whole = mesh(points[[0, side, -1, -side - 1]], [(0, 1, 2), (0, 2, 3)])
    whole_uv = grid[[0, side, -1, -side - 1]][[[0, 1, 2], [0, 2, 3]]]
    fine = render(surfaces, CAMERA, SIZE)
    coarse = render(place([whole], cutouts=cut(alpha, whole_uv)), CAMERA, SIZE)
    assert (fine.instance != coarse.instance).mean() < 2e-3  # float32 vertices move edges a little
    assert 500 < (fine.instance == 0).sum() < 3500


def test_coverage_counts_a_card_that_its_alpha_cuts_away():
    card = pixel_rectangle(CAMERA, 20, 10, 100, 50)
    surfaces = place([card], cutouts=cut([[0]], QUAD_UV))
    assert np.all(render(surfaces, CAMERA, SIZE).instance == -1)
    assert coverage(surfaces, CAMERA, SIZE).tolist() == [5]


def test_several_images_and_placements():
    alphas = (np.array([[255, 0]], np.uint8), np.array([[0], [255]], np.uint8))
    cards = [pixel_rectangle(CAMERA, 0, 0, 40, 40), pixel_rectangle(CAMERA, 60, 0, 100, 40)]
    cutouts = Cutouts(
        triangle_cutout=np.array([0, 0, 1, 1], np.int32),
        corner_uv=np.concatenate([QUAD_UV, QUAD_UV]),
        alphas=alphas,
        wrap=("extend", "extend"),
        interpolation=("closest", "closest"),
        sides=("both", "both"),
        threshold=0.5,
    )
    seen = render(place(cards, [(0, IDENTITY, 0), (1, IDENTITY, 1)], cutouts), CAMERA, SIZE)
    assert np.all(seen.instance[:40, :20] == 0)
    assert np.all(seen.instance[20:40, 60:100] == 1)
    assert (seen.instance == 0).sum() == (seen.instance == 1).sum() == 800


def test_alpha_between_corners_falls_where_it_is_interpolated():
    card = pixel_rectangle(CAMERA, 20, 10, 100, 50)
    # 1 at the left edge and 0.2 at the right one: 0.5 is passed after 5/8 of 80 pixels.
    left, right = 1.0, 0.2
    corners = np.where(QUAD_UV[..., 0] == 0, left, right)
    seen = render(
        place([card], cutouts=cut([[255]], QUAD_UV * 0, corner_alpha=corners)), CAMERA, SIZE
    )
    expected = np.full((90, 120), -1)
    expected[10:50, 20:70] = 0
    np.testing.assert_array_equal(seen.instance, expected)


@pytest.mark.parametrize("sides", ["both", "front", "back"])
@pytest.mark.parametrize("seed", range(4))
def test_corner_alpha_images_and_sides_against_the_oracle(sides, seed):
    rng = np.random.default_rng([seed, 7])
    alpha = rng.integers(60, 256, size=(3, 4), dtype=np.uint8)
    points = rng.uniform(-1, 1, size=(40, 3)) * [4, 3, 2] + [0, 0, 7]
    faces = rng.permutation(40)[:39].reshape(13, 3)
    cutouts = cut(
        alpha,
        rng.uniform(-1, 2, size=(13, 3, 2)),
        sides=sides,
        corner_alpha=rng.uniform(0, 2, size=(13, 3)),
        indices=rng.integers(-1, 1, 13),
    )
    for mirror in (1.0, -1.0):
        matrix = affine(np.diag([mirror, 1, 1]), (0, 0, 0))
        surfaces = place([mesh(points, faces)], [(0, matrix, 0)], cutouts=cutouts)
        seen, truth = render(surfaces, CAMERA, SIZE), oracle.render(surfaces, CAMERA, SIZE)
        assert ((seen.instance != truth.instance) & ~truth.doubtful).sum() == 0
        assert (seen.instance == 0).sum() > 0


def test_a_mirrored_placement_keeps_its_front():
    card = pixel_rectangle(CAMERA, 40, 30, 80, 60)
    mirrored = np.diag([-1.0, 1, 1])
    areas = {}
    for sides in ("both", "front", "back"):
        cutouts = cut([[255]], QUAD_UV * 0, sides=sides)
        for name, turn in (("plain", np.eye(3)), ("mirrored", mirrored)):
            placed = [(0, affine(turn, (0, 0, 0)), 0)]
            seen = render(place([card], placed, cutouts=cutouts), CAMERA, SIZE)
            areas[sides, name] = int((seen.instance == 0).sum())
    assert areas["both", "plain"] == areas["both", "mirrored"] == 40 * 30
    one = "front" if areas["front", "plain"] else "back"
    other = "back" if one == "front" else "front"
    assert areas[one, "plain"] == areas[one, "mirrored"] == 40 * 30
    assert areas[other, "plain"] == areas[other, "mirrored"] == 0
