"""The kernel's bytes do not depend on threads, orders or instruction sets."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from visibility.kernel_scenes import affine, mesh, pixel_camera, place, rotation, sphere

from legoworld.visibility.kernel import LEVEL_VARIABLE, LEVELS, Surfaces, render

SIZE = (333, 222)


def crowd(seed):
    """Balls, a floor through the near plane, coplanar copies and slivers, some sharing ids."""
    rng = np.random.default_rng(seed)
    floor = mesh(
        [(-50, 1.5, -50), (50, 1.5, -50), (50, 1.5, 50), (-50, 1.5, 50)], [(0, 1, 2), (0, 2, 3)]
    )
    walk = np.cumsum(rng.normal(size=(120, 3)) * [3, 1e-3, 1], axis=0)
    needle = mesh(walk + np.array([0, 0, 5]), np.arange(120))
    meshes = [sphere(8, 11), sphere(60, 90), floor, needle]
    at = [
        (
            int(rng.integers(2)),
            affine(rotation(rng) * 0.5, rng.uniform(-2, 2, 3) + np.array([0, 0, 6])),
            i // 2,
        )
        for i in range(40)
    ]
    still = affine(np.eye(3), (0, 0, 0))
    return place(meshes, [*at, (2, still, 50), (2, still, 51), (3, still, 52)])


def reorder_surfaces(surfaces: Surfaces, rng: np.random.Generator) -> Surfaces:
    """The same scene with its meshes, triangles and placements in another order."""
    meshes = len(surfaces.vertex_start) - 1
    order = rng.permutation(meshes)
    parts = []
    for m in order:
        v = surfaces.vertices[surfaces.vertex_start[m] : surfaces.vertex_start[m + 1]]
        t = surfaces.triangles[surfaces.triangle_start[m] : surfaces.triangle_start[m + 1]]
        parts.append((v, rng.permutation(t)))
    where = np.argsort(order)
    shuffle = rng.permutation(len(surfaces.placement_mesh))
    return place(
        parts,
        [
            (
                int(where[surfaces.placement_mesh[i]]),
                surfaces.cam_from_mesh[i],
                int(surfaces.placement_id[i]),
            )
            for i in shuffle
        ],
    )


def picture(surfaces, **options):
    seen = render(surfaces, pixel_camera(SIZE, fx=200.0, fy=190.0), SIZE, **options)
    return seen.instance.tobytes(), seen.depth_z_m.tobytes()


@pytest.mark.parametrize("seed", range(3))
def test_same_bytes_for_every_thread_count(seed):
    surfaces = crowd(seed)
    first = picture(surfaces, threads=1)
    for threads in (2, 3, 16, None):
        assert picture(surfaces, threads=threads) == first


@pytest.mark.parametrize("seed", range(6))
def test_same_bytes_for_every_order(seed):
    surfaces = crowd(seed)
    assert picture(reorder_surfaces(surfaces, np.random.default_rng(seed))) == picture(surfaces)


@pytest.mark.parametrize("seed", range(4))
def test_same_bytes_without_wide_vectors(seed, monkeypatch):
    surfaces = crowd(seed)
    wide = picture(surfaces)
    for level in LEVELS:
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        assert picture(surfaces) == wide


def test_large_and_small_meshes_take_the_same_way():
    # Meshes above a size are shared out between threads: one mesh, and the same in 40 parts.
    points, faces = sphere(150, 200)
    assert len(points) > 2 * 16384 - 4000
    at = affine(np.eye(3) * 1.5, (0, 0, 5))
    whole = picture(place([(points, faces)], [(0, at, 0)]), threads=2)
    parts = []
    for some in np.array_split(faces, 40):
        used, local = np.unique(some, return_inverse=True)
        parts.append(mesh(points[used], local.reshape(-1, 3)))
    assert picture(place(parts, [(i, at, 0) for i in range(40)]), threads=3) == whole


def test_calls_from_several_threads_do_not_disturb_each_other():
    from concurrent.futures import ThreadPoolExecutor

    scenes = [crowd(seed) for seed in range(4)]
    alone = [picture(s) for s in scenes]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda i: picture(scenes[i % 4], threads=2), range(12)))
    assert together == [alone[i % 4] for i in range(12)]


def test_inputs_are_left_alone():
    surfaces = crowd(0)
    before = {
        f.name: np.array(getattr(surfaces, f.name))
        for f in dataclasses.fields(surfaces)
        if f.name != "cutouts"
    }
    picture(surfaces)
    for name, array in before.items():
        np.testing.assert_array_equal(getattr(surfaces, name), array)
