"""The compiled search gives what every pair in float64 gives, bit for bit, ties included."""

from __future__ import annotations

import numpy as np
import pytest
from evaluation.reconstruction.brute_force import nearest
from evaluation.reconstruction.datasets import scene
from hypothesis import example, given, settings
from hypothesis import strategies as st

from legoworld.evaluation.reconstruction.nearest import (
    GridSurface,
    hits_between,
    nearest_between,
    share_raster,
)
from legoworld.evaluation.reconstruction.points import Raster, Tolerance, finite_points, points_m

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
        found = nearest_between(*share_raster(a, b, label, raster), lanes=lanes)
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
    found, _ = nearest_between(
        *share_raster(flat, checker.astype(np.float32), np.zeros(flat.shape, np.int32), raster)
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


def tolerances_of(*pairs):
    return tuple(Tolerance(name=f"{r} {a}", relative=r, absolute_m=a) for r, a in pairs)


ASKED = (
    tolerances_of((0.02, 0), (0.05, 0), (0.1, 0), (0, 0.05), (0, 0.1)),
    tolerances_of((0.05, 0)),
    tolerances_of((0, 0.2)),
    tolerances_of((0.6, 0), (1.5, 0.01)),
)


def hits_of(found, z, side, tolerance):
    tau = tolerance.tau_m(z if side == 0 else z[np.maximum(found.index.ravel(), 0)])
    return (found.index.ravel() >= 0) & (np.sqrt(found.squared_m2.ravel()) <= tau)


def check_decided(a, b, label, raster, tolerances):
    """Hits at each tolerance are those of the nearest, and answers are points at their distance."""
    surfaces = [GridSurface(depth_z_m=depth, label=label, raster=raster) for depth in (a, b)]
    whole = nearest_between(*surfaces)
    points = [points_m(depth, raster).reshape(-1, 3) for depth in (a, b)]
    z = np.where(np.isfinite(a), a, 0).ravel().astype(np.float64)
    labels = label.ravel()
    for lanes in LANES:
        found = nearest_between(*surfaces, tolerances=tolerances, lanes=lanes)
        counted = hits_between(*surfaces, 7, tolerances, lanes=lanes)
        for side, (some, every) in enumerate(zip(found, whole, strict=True)):
            there = finite_points((a, b)[side]).ravel() & (labels >= 0)
            np.testing.assert_array_equal(
                (counted.n_a, counted.n_b)[side], np.bincount(labels[there], minlength=7)
            )
            for k, one in enumerate(tolerances):
                expected = hits_of(every, z, side, one)
                np.testing.assert_array_equal(hits_of(some, z, side, one), expected)
                np.testing.assert_array_equal(
                    (counted.a, counted.b)[side][:, k], np.bincount(labels[expected], minlength=7)
                )
            kept = np.flatnonzero(some.index.ravel() >= 0)
            other = some.index.ravel()[kept]
            d = points[side][kept] - points[1 - side][other]
            squared = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] + d[:, 2] * d[:, 2]
            np.testing.assert_array_equal(some.squared_m2.ravel()[kept], squared)
            assert (labels[other] == labels[kept]).all()


@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize("tolerances", ASKED)
def test_asked_for_tolerances_the_hits_are_those_of_the_nearest(kind, tolerances):
    random = np.random.default_rng(len(kind))
    raster = raster_of(61, 43)
    a, _ = scene(raster, 5)
    b = np.float32(SURFACES[kind](a, random))
    for label in (np.zeros(a.shape, np.int32), patches(a.shape, random).astype(np.int32)):
        check_decided(a, b, label, raster, tolerances)


@given(
    width=st.integers(1, 40), height=st.integers(1, 30), seed=st.integers(0, 2**32 - 1),
    labels=st.integers(1, 5), rounded=st.sampled_from([1, 2, 6]), side=st.sampled_from([3, 9]),
    asked=st.lists(
        st.tuples(st.sampled_from([0, 0.01, 0.25, 0.9]), st.sampled_from([0, 0.1, 0.25])),
        min_size=1, max_size=4,
    ),
)  # fmt: skip
@example(width=14, height=1, seed=2**32 - 2, labels=1, rounded=1, side=9, asked=[(0, 0), (0, 0.25)])
@settings(max_examples=60, deadline=None)
def test_hits_of_any_raster_at_any_tolerances(width, height, seed, labels, rounded, side, asked):
    """Depths and tolerances are round, so that many distances equal a tolerance."""
    random = np.random.default_rng(seed)
    raster = raster_of(width, height, focal=random.choice([0.25, 1.0, 4.0]))
    a, _ = scene(raster, seed)
    b, _ = scene(raster, seed + random.integers(0, 2))
    scale = random.choice([0.75, 0.99, 1.0, 1.25])
    check_decided(
        np.round(a, rounded), np.round(np.float32(b * scale), rounded),
        patches(a.shape, random, labels, side).astype(np.int32), raster, tolerances_of(*asked),
    )  # fmt: skip


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
    found, back = nearest_between(*share_raster(a, b, label, raster))
    places = np.random.default_rng(0).choice(a.size, 150, replace=False)
    for result, (x, y) in ((found, (a, b)), (back, (b, a))):
        some = np.full(a.shape, np.inf, np.float32)
        some.ravel()[places] = x.ravel()[places]
        squared, index = nearest(some, y, label, raster)
        kept = np.isfinite(some)
        np.testing.assert_array_equal(result.squared_m2[kept], squared[kept])
        np.testing.assert_array_equal(result.index[kept], index[kept])
