"""Placements left out as a whole do not show: one mesh of the same triangles gives the same bytes.

The kernel draws many placements in rounds, nearest first, and leaves out those that lie behind what
earlier rounds drew. One mesh with one placement has no second round and is never left out, so a
scene whose placements are baked into one mesh is the same picture with nothing left out. Moves are
by multiples of 1/1024 and meshes lie on that grid, so that baking is exact in float32.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from visibility import oracle
from visibility.kernel_scenes import (
    IDENTITY,
    affine,
    mesh,
    pixel_camera,
    pixel_rectangle,
    place,
    sphere,
)

from legoworld.visibility.kernel import (
    HOLDOUT,
    LEVEL_VARIABLE,
    LEVELS,
    Buffers,
    Cutouts,
    Surfaces,
    render,
)

SIZE = (96, 72)
CAMERA = pixel_camera(SIZE)
ORTHOGRAPHIC = pixel_camera(SIZE, orthographic=True, fx=14.0, fy=14.0, z_near=-1.0)
GRID = 1024


def snap_points(points):
    return np.round(np.asarray(points, float) * GRID) / GRID


def ball(rings=8, segments=12, radius=0.3):
    points, faces = sphere(rings, segments, radius)
    return mesh(snap_points(points), faces)


def rock(rng):
    """A ball with a rough surface."""
    points, faces = sphere(8, 12, 0.3)
    return mesh(snap_points(points * rng.uniform(0.6, 1.2, size=(len(points), 1))), faces)


def shifts(rng, count, low, high) -> NDArray[np.float64]:
    return snap_points(rng.uniform(low, high, size=(count, 3)))


def crowd(rng, count, low=(-2.5, -2.0, 3.0), high=(2.5, 2.0, 14.0)):
    """Two shapes at random places, every id twice."""
    meshes = [ball(), rock(rng)]
    at = [
        (int(rng.integers(2)), affine(np.eye(3), shift), i // 2)
        for i, shift in enumerate(shifts(rng, count, low, high))
    ]
    return meshes, at


def bake_placements(surfaces: Surfaces, ident: int) -> Surfaces:
    """All placements of one id as one mesh in the camera's frame."""
    points, faces, cuts, uv, offset = [], [], [], [], 0
    for placement in np.flatnonzero(surfaces.placement_id == ident):
        m, matrix = surfaces.placement_mesh[placement], surfaces.cam_from_mesh[placement]
        v = surfaces.vertices[surfaces.vertex_start[m] : surfaces.vertex_start[m + 1]]
        own = slice(surfaces.triangle_start[m], surfaces.triangle_start[m + 1])
        moved_points = v.astype(np.float64) @ matrix[:, :3].T + matrix[:, 3]
        assert np.array_equal(moved_points.astype(np.float32), moved_points)
        points.append(moved_points)
        faces.append(surfaces.triangles[own] + offset)
        offset += len(v)
        if surfaces.cutouts is not None:
            cuts.append(surfaces.cutouts.triangle_cutout[own])
            uv.append(surfaces.cutouts.corner_uv[own])
    cutouts = surfaces.cutouts
    if cutouts is not None:
        cutouts = dataclasses.replace(
            cutouts, triangle_cutout=np.concatenate(cuts), corner_uv=np.concatenate(uv)
        )
    one = mesh(np.concatenate(points), np.concatenate(faces))
    return place([one], [(0, IDENTITY, ident)], cutouts)


def nothing_left_out(surfaces: Surfaces, camera, size_wh=SIZE, depth_scale=1.0) -> Buffers:
    """The picture from one render per id, put together by the rule: smaller depth, then lower id.

    Holdouts are drawn as an id above all others, so that their depth can be seen, then erased; on
    equal depth they win.
    """
    width, height = size_wh
    depth = np.full((height, width), np.inf, np.float32)
    instance = np.full((height, width), np.iinfo(np.int32).max, np.int32)
    for ident in np.unique(surfaces.placement_id):
        one = bake_placements(surfaces, int(ident))
        shown = dataclasses.replace(one, placement_id=np.array([7], np.int32))
        alone = render(shown, camera, size_wh, depth_scale=depth_scale)
        wins = (alone.depth_z_m < depth) | (
            (alone.depth_z_m == depth) & (alone.instance >= 0) & (ident < instance)
        )
        depth = np.where(wins, alone.depth_z_m, depth)
        instance = np.where(wins, np.int32(ident), instance)
    seen = (instance >= 0) & (instance != np.iinfo(np.int32).max)
    return Buffers(
        instance=np.where(seen, instance, -1).astype(np.int32),
        depth_z_m=np.where(seen, depth, np.float32(np.inf)).astype(np.float32),
    )


def assert_same(surfaces: Surfaces, camera=CAMERA, size_wh=SIZE, **options) -> Buffers:
    pixels = size_wh[0] * size_wh[1]
    counts = np.diff(surfaces.triangle_start)[surfaces.placement_mesh]
    assert counts.sum() > 2 * pixels, "too few triangles for a second round"
    expected = nothing_left_out(surfaces, camera, size_wh, **options)
    for threads in (1, 2, 5):
        seen = render(surfaces, camera, size_wh, threads=threads, **options)
        assert seen.instance.tobytes() == expected.instance.tobytes()
        assert seen.depth_z_m.tobytes() == expected.depth_z_m.tobytes()
    return expected


@pytest.mark.parametrize("camera", [CAMERA, ORTHOGRAPHIC], ids=["perspective", "orthographic"])
@pytest.mark.parametrize("seed", range(4))
def test_a_crowd(seed, camera):
    seen = assert_same(place(*crowd(np.random.default_rng(seed), 800)), camera)
    assert 20 < len(np.unique(seen.instance)) < 380


@pytest.mark.parametrize("size_wh", [(1, 1), (65, 9), (97, 71), (130, 127)])
def test_a_crowd_in_pictures_that_end_inside_a_block(size_wh):
    camera = pixel_camera(size_wh, fx=60.0, fy=60.0)
    assert_same(place(*crowd(np.random.default_rng(5), 400)), camera, size_wh)


@pytest.mark.parametrize("depth_scale", [1e-3, 0.3048, 1e3])
def test_a_crowd_in_other_units(depth_scale):
    surfaces = place(*crowd(np.random.default_rng(6), 300))
    assert_same(surfaces, depth_scale=depth_scale)


def test_a_crowd_without_wide_vectors(monkeypatch):
    surfaces = place(*crowd(np.random.default_rng(7), 300))
    wide = assert_same(surfaces)
    for level in LEVELS:
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        assert render(surfaces, CAMERA, SIZE).instance.tobytes() == wide.instance.tobytes()
        assert_same(surfaces)


@pytest.mark.parametrize("seed", range(2))
def test_thousands_behind_a_wall_and_a_few_before_it(seed):
    rng = np.random.default_rng(seed)
    meshes, at = crowd(rng, 3000, low=(-3.0, -2.5, 6.5), high=(3.0, 2.5, 14.0))
    wall = pixel_rectangle(CAMERA, -1, -1, 97, 73, z=6.0)
    meshes.append(mesh(snap_points(wall[0]), wall[1]))
    front = [
        (0, affine(np.eye(3), shift), 5000 + i)
        for i, shift in enumerate(shifts(rng, 5, (-1, -1, 4), (1, 1, 5)))
    ]
    seen = assert_same(place(meshes, [*at, *front, (2, IDENTITY, 4000)]))
    assert set(np.unique(seen.instance)) == {4000, *(ident for _, _, ident in front)}


@pytest.mark.parametrize("hole", [(31, 31, 33, 33), (48, 24, 49, 25), (95, 71, 96, 72)])
def test_what_shows_through_one_hole_in_a_wall(hole):
    # The wall is four rectangles around a hole of one or a few pixels.
    u0, v0, u1, v1 = hole
    around = [(-1, -1, 97, v0), (-1, v1, 97, 73), (-1, v0, u0, v1), (u1, v0, 97, v1)]
    walls = [pixel_rectangle(CAMERA, *edges, z=4.0) for edges in around]
    points = np.concatenate([v for v, _ in walls])
    wall = mesh(snap_points(points), np.concatenate([t + 4 * i for i, (_, t) in enumerate(walls)]))
    rng = np.random.default_rng(1)
    meshes, at = crowd(rng, 1500, low=(-6.0, -5.0, 5.0), high=(6.0, 5.0, 14.0))
    seen = assert_same(place([*meshes, wall], [*at, (2, IDENTITY, 3000)]))
    inside = seen.instance[v0:v1, u0:u1]
    assert np.all((inside >= 0) & (inside < 3000))
    assert (seen.instance == 3000).sum() >= SIZE[0] * SIZE[1] - 2 * (u1 - u0 + 2) * (v1 - v0 + 2)


def test_placements_half_behind_a_wall():
    rng = np.random.default_rng(2)
    meshes, at = crowd(rng, 800, low=(-1.0, -2.0, 5.5), high=(1.0, 2.0, 9.0))
    half = pixel_rectangle(CAMERA, -1, -1, 48.3, 73, z=5.0)
    meshes.append(mesh(snap_points(half[0]), half[1]))
    seen = assert_same(place(meshes, [*at, (2, IDENTITY, 3000)]))
    assert np.all(seen.instance[:, :46] == 3000)
    assert len(np.unique(seen.instance[:, 50:])) > 20


@pytest.mark.parametrize("z_near", [0.1, 1.0, 4.0])
def test_placements_that_cross_the_near_plane_and_the_far_plane(z_near):
    rng = np.random.default_rng(3)
    camera = pixel_camera(SIZE, z_near=z_near, z_far=z_near + 3)
    surfaces = place(*crowd(rng, 900, low=(-1.5, -1.5, -2.0), high=(1.5, 1.5, 8.0)))
    first = surfaces.cam_from_mesh[:, 2, 3] - 0.3
    assert ((first < z_near) & (first + 0.6 > z_near)).sum() > 20
    seen = assert_same(surfaces, camera)
    assert (seen.instance >= 0).mean() > 0.3


def test_coplanar_ties_between_placements_of_every_round():
    # Square tiles in one plane, overlapping, with ids against their order; and the same rear plane.
    tile = mesh([(0, 0, 0), (0.5, 0, 0), (0.5, 0.5, 0), (0, 0.5, 0)], [(0, 1, 2), (0, 2, 3)])
    fine = mesh(
        snap_points([(x / 16, y / 16, 0) for y in range(17) for x in range(17)]),
        [
            face
            for y in range(16)
            for x in range(16)
            for a in [17 * y + x]
            for face in ((a, a + 1, a + 18), (a, a + 18, a + 17))
        ],
    )
    rng = np.random.default_rng(4)
    ids = rng.permutation(600)
    at = [
        (int(i % 2), affine(np.eye(3), (*shift[:2], 5.0)), int(ids[i]))
        for i, shift in enumerate(shifts(rng, 600, (-3, -2, 0), (2, 2, 1)))
    ]
    seen = assert_same(place([tile, fine], at))
    assert set(np.unique(seen.depth_z_m)) <= {np.float32(5), np.float32(np.inf)}
    assert len(np.unique(seen.instance)) > 10


@pytest.mark.parametrize("behind", [0, 500])
def test_a_layer_that_hides_nothing_of_itself(behind):
    # After a round asked in vain no more are asked; what lies farther back must still be drawn.
    rng = np.random.default_rng(3)
    step = 666 / GRID
    at = [(x * step, y * step, 30.0) for x in range(-14, 14) for y in range(-14, 14)]
    far = shifts(rng, behind, (-12.0, -12.0, 34.0), (12.0, 12.0, 60.0))
    places = [*at, *(tuple(shift) for shift in far)]
    surfaces = place(
        [ball()], [(0, affine(np.eye(3), shift), i // 4) for i, shift in enumerate(places)]
    )
    seen = assert_same(surfaces)
    assert len(np.unique(seen.instance)) > len(places) / 4 * (1 if behind == 0 else 0.7)


def test_copies_in_one_place_show_the_lowest_id_whichever_comes_last():
    # 300 balls in each of three places, at exactly one depth: rounds divide the copies.
    places = [(-0.5, 0.0, 4.0), (0.25, 0.25, 4.0), (0.0, -0.25, 5.0)]
    for step in (1, -1):
        at = [
            (0, affine(np.eye(3), shift), 3 * i + k)
            for i in range(300)[::step]
            for k, shift in enumerate(places)
        ]
        seen = assert_same(place([ball()], at))
        assert np.unique(seen.instance).tolist() == [-1, 0, 1, 2]


def test_a_card_cut_away_by_its_alpha_hides_nothing():
    rng = np.random.default_rng(5)
    meshes, at = crowd(rng, 600, low=(-2.5, -2.0, 5.0), high=(2.5, 2.0, 9.0))
    card = pixel_rectangle(CAMERA, -1, -1, 97, 73, z=3.0)
    meshes.append(mesh(snap_points(card[0]), card[1]))
    faces = sum(len(t) for _, t in meshes)
    uv = np.zeros((faces, 3, 2), np.float32)
    uv[-2:] = [[(0, 1), (1, 1), (1, 0)], [(0, 1), (1, 0), (0, 0)]]
    index = np.full(faces, -1, np.int32)
    index[-2:] = 0
    alpha = np.where(rng.random((9, 12)) < 0.5, 255, 0).astype(np.uint8)
    cutouts = Cutouts(
        triangle_cutout=index,
        corner_uv=uv,
        alphas=(alpha,),
        wrap=("extend",),
        interpolation=("closest",),
        sides=("both",),
        threshold=0.5,
    )
    at = [*at, (2, IDENTITY, 4000)]
    seen = assert_same(place(meshes, at, cutouts))
    assert 0.2 < (seen.instance == 4000).mean() < 0.8
    assert ((seen.instance >= 0) & (seen.instance < 4000)).mean() > 0.1
    gone = dataclasses.replace(cutouts, alphas=(np.zeros_like(alpha),))
    without = render(place(meshes[:2], at[:-1]), CAMERA, SIZE)
    through = render(place(meshes, at, gone), CAMERA, SIZE)
    assert through.instance.tobytes() == without.instance.tobytes()
    assert through.depth_z_m.tobytes() == without.depth_z_m.tobytes()


def test_a_holdout_of_an_early_round_hides_and_is_erased():
    rng = np.random.default_rng(6)
    meshes, at = crowd(rng, 900, low=(-2.5, -2.0, 4.5), high=(2.5, 2.0, 9.0))
    veil = pixel_rectangle(CAMERA, 20, 16, 72, 60, z=4.0)
    meshes.append(mesh(snap_points(veil[0]), veil[1]))
    seen = assert_same(place(meshes, [*at, (2, IDENTITY, HOLDOUT)]))
    assert np.all(seen.instance[18:58, 22:70] == -1)
    assert np.all(np.isposinf(seen.depth_z_m[18:58, 22:70]))
    assert (seen.instance >= 0).sum() > 500


def test_meshes_shared_between_threads_are_left_out_too():
    # More vertices than one worker takes alone, in several rounds, some behind others.
    rng = np.random.default_rng(7)
    big = ball(120, 150, 0.75)
    assert len(big[0]) > 16384
    at = [
        (i % 2, affine(np.eye(3), shift), i)
        for i, shift in enumerate(shifts(rng, 24, (-0.5, -0.5, 3), (0.5, 0.5, 9)))
    ]
    seen = assert_same(place([big, ball()], at))
    assert len(np.unique(seen.instance)) < 20


def test_placements_between_pixel_centres_and_outside_the_view():
    rng = np.random.default_rng(8)
    speck = ball(8, 12, 24 / GRID)
    far = shifts(rng, 2000, (-9, -9, 4), (9, 9, 40))
    at = [(0, affine(np.eye(3), shift), i) for i, shift in enumerate(far)]
    meshes, near = crowd(rng, 200, low=(-2.5, -2.0, 3.0), high=(-0.5, 2.0, 9.0))
    near = [(m + 1, matrix, 5000 + ident) for m, matrix, ident in near]
    seen = assert_same(place([speck, *meshes], [*at, *near]))
    assert 5 < ((seen.instance >= 0) & (seen.instance < 5000)).sum() < 400


def test_rounds_agree_with_the_oracle():
    size_wh = (24, 18)
    camera = pixel_camera(size_wh, fx=25.0, fy=25.0)
    surfaces = place(*crowd(np.random.default_rng(9), 16))
    seen = render(surfaces, camera, size_wh)
    truth = oracle.render(surfaces, camera, size_wh)
    sure = ~truth.doubtful
    np.testing.assert_array_equal(seen.instance[sure], truth.instance[sure])
    assert sure.mean() > 0.95
    hit = sure & (truth.instance >= 0)
    error = np.abs(seen.depth_z_m[hit] / truth.depth_z_m[hit] - 1)
    assert error.max() <= 2.0**-24 * (1 + 1e-6)
