"""Why a placement shows nothing."""

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

SIZE = (100, 80)
CAMERA = pixel_camera(SIZE, z_near=1.0, z_far=50.0)


def code(one_mesh, matrix=IDENTITY, camera=CAMERA):
    return int(coverage(place([one_mesh], [(0, matrix, 0)]), camera, SIZE)[0])


@pytest.mark.parametrize(
    ("rectangle", "expected"),
    [
        ((10, 10, 50, 50, 5.0), 5),
        ((10.4, 10.4, 10.6, 10.6, 5.0), 5),
        ((10.6, 10.6, 11.4, 11.4, 5.0), 4),
        ((10, 10.6, 50, 11.4, 5.0), 4),
        ((-30, 10, -1, 50, 5.0), 3),
        ((10, 81, 50, 90, 5.0), 3),
        ((-0.4, 10, 0.4, 50, 5.0), 4),
        ((10, 10, 50, 50, 50.1), 2),
        ((10, 10, 50, 50, 50.0), 5),
        ((10, 10, 50, 50, 0.99), 1),
    ],
)
def test_codes_of_a_rectangle(rectangle, expected):
    assert code(pixel_rectangle(CAMERA, *rectangle)) == expected


def test_behind_the_camera_is_nearer_than_the_near_plane():
    assert code(sphere(6, 8), affine(np.eye(3), (0, 0, -5))) == 1


def test_nothing_with_an_area():
    assert code(mesh([(0, 0, 5)], [])) == 0
    assert code(mesh([(0, 0, 5), (1, 1, 6), (2, 2, 7)], [(0, 1, 2), (1, 1, 2)])) == 0
    assert code(sphere(6, 8), affine(np.zeros((3, 3)), (0, 0, 5))) == 0


def test_edge_on_in_view_lies_between_centres():
    assert code(mesh([(0, -1, 2), (0, 1, 2), (0, 1, 9)], [(0, 1, 2)])) == 4


def test_the_best_triangle_counts():
    behind, outside = (
        mesh([(0, 0, -5), (1, 0, -5), (0, 1, -5)], [(0, 1, 2)]),
        [(90, 0, 5), (91, 0, 5), (90, 1, 5)],
    )
    points = np.concatenate([behind[0], outside])
    assert code(mesh(points, [(0, 1, 2), (3, 4, 5)])) == 3


def test_a_triangle_that_crosses_the_near_plane_beside_the_view_is_outside():
    assert code(mesh([(5, -1, -9), (5, 1, -9), (5, 0, 9)], [(0, 1, 2)])) == 3
    assert code(mesh([(0.1, -1, -9), (0.1, 1, -9), (0.1, 0, 9)], [(0, 1, 2)])) == 5


def test_a_spike_of_which_only_an_end_lies_in_the_clip_range():
    # It covers centres beyond z_far only; the part within the range is thinner than a pixel.
    spike = mesh([(0.004, 0.004, 49), (30, 0, 900), (30, 30, 900)], [(0, 1, 2)])
    assert code(spike) == 4


def test_orthographic():
    camera = pixel_camera(SIZE, orthographic=True, fx=10.0, fy=10.0, z_near=-1.0, z_far=50.0)
    assert code(pixel_rectangle(camera, 10, 10, 50, 50, -0.5), camera=camera) == 5
    assert code(pixel_rectangle(camera, 10, 10, 50, 50, -1.5), camera=camera) == 1
    assert code(pixel_rectangle(camera, 110, 10, 150, 50, 5), camera=camera) == 3
    assert code(pixel_rectangle(camera, 10.6, 10.6, 11.4, 11.4, 5), camera=camera) == 4


@pytest.mark.parametrize("seed", range(10))
def test_five_exactly_where_a_render_of_the_placement_alone_shows_it(seed):
    rng = np.random.default_rng(seed)
    meshes = [sphere(5, 7), mesh(rng.normal(size=(6, 3)) * 5, np.arange(6))]
    at = [
        (
            int(rng.integers(2)),
            affine(
                rotation(rng) * 10.0 ** rng.uniform(-3, 0.5), rng.normal(size=3) * 4 + [0, 0, 4]
            ),
            i,
        )
        for i in range(60)
    ]
    codes = coverage(place(meshes, at), CAMERA, SIZE, threads=2)
    assert len(set(codes.tolist())) >= 3
    for placement, got in zip(at, codes, strict=True):
        alone = render(place(meshes, [placement]), CAMERA, SIZE)
        assert (got == 5) == bool(np.any(alone.instance >= 0))


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_a_box_beside_the_view_decides_as_all_its_triangles_do(seed, orthographic):
    """Vertices that no triangle uses, far out on all sides, leave nothing to a mesh's box."""
    rng = np.random.default_rng(seed)
    size = {"fx": 8.0, "fy": 8.0} if orthographic else {}
    camera = pixel_camera(SIZE, orthographic=orthographic, z_near=1.0, z_far=50.0, **size)
    meshes = [sphere(5, 7), mesh(rng.normal(size=(30, 3)), np.arange(30))]
    strays = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 1e6
    at = [
        (
            int(rng.integers(2)),
            affine(rotation(rng) * 10.0 ** rng.uniform(-2, 0.7), rng.normal(size=3) * (12, 12, 30)),
            i,
        )
        for i in range(400)
    ]
    codes = coverage(place(meshes, at), camera, SIZE)
    asked = [mesh(np.concatenate([points, strays]), faces) for points, faces in meshes]
    assert codes.tolist() == coverage(place(asked, at), camera, SIZE).tolist()
    assert {1, 2, 3, 5} <= set(codes.tolist())


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_placement_is_the_best_of_its_triangles_each_asked_alone(seed, orthographic):
    """Once one of them is beside the view, others beside it are passed over without their edges."""
    rng = np.random.default_rng(seed)
    size = {"fx": 8.0, "fy": 8.0} if orthographic else {}
    camera = pixel_camera(SIZE, orthographic=orthographic, z_near=1.0, z_far=50.0, **size)
    points, faces = sphere(6, 8)
    at = [
        affine(
            rotation(rng) * 10.0 ** rng.uniform(-1, 0.7),
            rng.normal(size=3) * (9, 9, 8) + (0, 0, 12),
        )
        for _ in range(40)
    ]
    whole = coverage(place([(points, faces)], [(0, m, 0) for m in at]), camera, SIZE)
    alone = place([(points, faces[i : i + 1]) for i in range(len(faces))],
                  [(i, m, 0) for m in at for i in range(len(faces))])  # fmt: skip
    best = coverage(alone, camera, SIZE).reshape(len(at), len(faces)).max(1)
    assert whole.tolist() == best.tolist()
    assert {3, 5} <= set(whole.tolist())
