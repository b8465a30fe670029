"""The compiled search gives what every pair in float64 gives, bit for bit, ties included."""

from __future__ import annotations

import numpy as np
import pytest
from evaluation.reconstruction.brute_force import nearest
from evaluation.reconstruction.datasets import scene
from hypothesis import given, settings
from hypothesis import strategies as st

from legoworld.evaluation.reconstruction.nearest import (
    GridSurface,
    Reach,
    nearest_between,
    nearest_both_ways,
)
from legoworld.evaluation.reconstruction.points import Raster, points_m


#: float64 numbers in a vector: AVX-512, AVX2 and what every CPU has, where this one has them.
LANES = (8, 4, 2)


def raster_of(width, height, focal=0.9):
    return Raster(
        fx=width * focal, fy=width * focal, cx=width / 2, cy=height / 2, width=width, height=height
    )


def check(a, b, label, raster):
    a, b, label = np.float32(a), np.float32(b), np.int32(label)
    expected = [nearest(x, y, label, raster) for x, y in ((a, b), (b, a))]
    for lanes in LANES:
        found = nearest_both_ways(a, b, label, raster, lanes=lanes)
        for one, (squared, index) in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one.squared_m2, squared)
            np.testing.assert_array_equal(one.index, index)


def patches(shape, random, labels=3, side=6):
    small = random.integers(-1, labels, (shape[0] // side + 1, shape[1] // side + 1))
    return small.repeat(side, 0).repeat(side, 1)[: shape[0], : shape[1]]


SURFACES = {
    "the same": lambda a, _: a,
    "2 % farther": lambda a, _: a * 1.02,
    "half as far": lambda a, _: a * 0.5,
    "three times as far": lambda a, _: a * 3,
    "a wall before it": lambda a, _: np.full_like(a, 0.7),
    "a wall far behind": lambda a, _: np.full_like(a, 90.0),
    "noise": lambda a, r: a * (1 + 0.1 * r.standard_normal(a.shape)),
    "all over the place": lambda a, r: r.choice([0.5, 1, 2, 30, 600, 1e30], a.shape),
    "no points": lambda a, _: np.full_like(a, np.inf),
    "a single point": lambda a, _: np.where(np.arange(a.size).reshape(a.shape) == 77, 2, np.nan),
    "what is no depth": lambda a, r: r.choice([np.inf, np.nan, -np.inf, 0, -3, 1.5], a.shape),
}


@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize("size", [(61, 43), (8, 8), (3, 50)])
def test_the_nearest_of_every_point_is_brute_force_s(kind, size):
    random = np.random.default_rng(len(kind))
    raster = raster_of(*size)
    a, _ = scene(raster, 5)
    b = SURFACES[kind](a, random)
    check(a, b, np.zeros(a.shape), raster)
    check(a, b, patches(a.shape, random), raster)


def test_equal_distances_go_to_the_lower_raster_index():
    # Rays of a camera far away are all but parallel: whole rows are at equal distances.
    raster = Raster(fx=4.0, fy=4.0, cx=0.5, cy=0.5, width=24, height=24)
    flat = np.full((24, 24), 4.0, np.float32)
    checker = np.where((np.indices(flat.shape).sum(axis=0) % 2).astype(bool), 4.0, np.inf)
    check(flat, checker, np.zeros(flat.shape), raster)
    found, _ = nearest_both_ways(
        flat, checker.astype(np.float32), np.zeros(flat.shape, np.int32), raster
    )
    # (1, 1) lies between (0, 1), (1, 0), (1, 2) and (2, 1), all a pixel away: the first is taken.
    assert found.index[1, 1] == 1
    assert found.squared_m2[1, 1] == 1.0


@given(
    width=st.integers(1, 40), height=st.integers(1, 30), seed=st.integers(0, 2**32 - 1),
    labels=st.integers(1, 5), rounded=st.sampled_from([0, 1, 6]), side=st.sampled_from([1, 3, 9]),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_any_raster_labels_and_depths(width, height, seed, labels, rounded, side):
    random = np.random.default_rng(seed)
    raster = raster_of(width, height, focal=random.uniform(0.2, 5))
    a, _ = scene(raster, seed)
    b, _ = scene(raster, seed + random.integers(0, 2))
    check(
        np.round(a, rounded), np.round(b * random.uniform(0.5, 2), rounded),
        patches(a.shape, random, labels, side), raster,
    )  # fmt: skip


@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize(("relative", "absolute"), [(0.1, 0.1), (0.05, 0.0), (0.0, 0.2), (0.6, 0)])
def test_within_reach_the_answers_are_the_same_and_beyond_there_is_none(kind, relative, absolute):
    random = np.random.default_rng(len(kind))
    raster = raster_of(61, 43)
    a, _ = scene(raster, 5)
    b = np.float32(SURFACES[kind](a, random))
    reach = Reach(relative=relative, absolute_m=absolute)
    for label in (np.zeros(a.shape, np.int32), patches(a.shape, random).astype(np.int32)):
        whole = nearest_both_ways(a, b, label, raster)
        for lanes in LANES:
            found = nearest_both_ways(a, b, label, raster, reach=reach, lanes=lanes)
            for side, (some, every) in enumerate(zip(found, whole, strict=True)):
                kept = some.index >= 0
                np.testing.assert_array_equal(some.squared_m2[kept], every.squared_m2[kept])
                np.testing.assert_array_equal(some.index[kept], every.index[kept])
                assert np.isinf(some.squared_m2[~kept]).all()
                # Whatever a tolerance can make a hit is an answer.
                known = every.index >= 0
                z = a if side == 0 else np.where(known, a.ravel()[every.index], 0)
                z = np.where(np.isfinite(z), z, 0).astype(np.float64)
                tau = np.maximum(relative * z, absolute)
                assert kept[known & (np.sqrt(every.squared_m2) <= tau)].all()


@pytest.mark.parametrize("degrees", [0.0, 0.3, 7.0, 170.0])
def test_moved_points_of_another_camera_are_brute_force_s_too(degrees):
    """Labels and rays of their own, and a rigid motion, in the order that it is written in."""
    random = np.random.default_rng(3)
    raster, other = raster_of(37, 29), raster_of(37, 29, focal=1.3)
    a, _ = scene(raster, 5)
    b, _ = scene(other, 6)
    angle = np.radians(degrees)
    motion = np.array([
        [np.cos(angle), 0.0, np.sin(angle), 0.1],
        [0.0, 1.0, 0.0, -0.02],
        [-np.sin(angle), 0.0, np.cos(angle), 0.3],
    ])  # fmt: skip
    labels = [patches(a.shape, random).astype(np.int32) for _ in range(2)]
    still = points_m(a, raster).reshape(-1, 3)
    x, y, z = points_m(b, other).reshape(-1, 3).T
    with np.errstate(invalid="ignore"):  # where there is no point
        moved = np.stack([m[0] * x + m[1] * y + m[2] * z + m[3] for m in motion], axis=-1)
    one = GridSurface(depth_z_m=a, label=labels[0], raster=raster)
    two = GridSurface(depth_z_m=b, label=labels[1], raster=other, motion=motion)
    for lanes in LANES:
        found = nearest_between(one, two, lanes=lanes)
        for result, (p, lp, q, lq) in zip(
            found,
            ((still, labels[0], moved, labels[1]), (moved, labels[1], still, labels[0])),
            strict=True,
        ):
            for place in np.flatnonzero((lp.ravel() >= 0) & np.isfinite(p).all(axis=1)):
                targets = np.flatnonzero(
                    (lq.ravel() == lp.ravel()[place]) & np.isfinite(q).all(axis=1)
                )
                if not len(targets):
                    assert result.index.ravel()[place] == -1
                    continue
                d = p[place] - q[targets]
                every = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] + d[:, 2] * d[:, 2]
                assert result.squared_m2.ravel()[place] == every.min()
                assert result.index.ravel()[place] == targets[every.argmin()]


def test_a_whole_scoring_raster_against_a_sample_of_brute_force():
    raster = raster_of(421, 237)
    (a, _), (b, _) = scene(raster, 1, 9), scene(raster, 2, 9)
    label = np.zeros(a.shape, np.int32)
    found, back = nearest_both_ways(a, b, label, raster)
    places = np.random.default_rng(0).choice(a.size, 150, replace=False)
    for result, (x, y) in ((found, (a, b)), (back, (b, a))):
        some = np.full(a.shape, np.inf, np.float32)
        some.ravel()[places] = x.ravel()[places]
        squared, index = nearest(some, y, label, raster)
        kept = np.isfinite(some)
        np.testing.assert_array_equal(result.squared_m2[kept], squared[kept])
        np.testing.assert_array_equal(result.index[kept], index[kept])
