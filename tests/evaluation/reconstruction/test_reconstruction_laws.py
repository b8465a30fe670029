"""What R must do, whatever the scene; every one of these is a fault of some published evaluator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from evaluation.reconstruction import brute_force
from evaluation.reconstruction.datasets import scene

from legoworld.evaluation.reconstruction.fscore import (
    Score,
    match_clouds,
    match_surfaces,
    mean_f1,
    scores,
)
from legoworld.evaluation.reconstruction.nearest import share_raster
from legoworld.evaluation.reconstruction.points import (
    Raster,
    Tolerance,
    finite_points,
    picture_raster,
    point_pixels,
    points_m,
)
from legoworld.evaluation.reconstruction.protocol import bench_protocol
from legoworld.evaluation.reconstruction.reference import containing_pixels

RASTER = picture_raster((160, 90), 50.0, (80, 45))
FIVE = Tolerance(name="F5", relative=0.05)
TEN = Tolerance(name="F10", relative=0.1)


@pytest.fixture(scope="module", params=range(4))
def case(request):
    depth, instance = scene(RASTER, request.param)
    return depth, (instance - 1).astype(np.int32)


def found(reference, submitted, label, tolerance=FIVE, raster=RASTER):
    pairs = match_surfaces(
        *share_raster(np.float32(reference), np.float32(submitted), label, raster)
    )
    return scores(pairs, int(label.max()) + 1, tolerance)


def test_the_reference_submitted_as_itself_scores_one_for_every_object(case):
    depth, label = case
    for tolerance in (bench_protocol().headline, *bench_protocol().others):
        assert {s.f1 for s in found(depth, depth, label, tolerance) if s.n_reference} == {1.0}
    assert mean_f1(found(depth, depth, label)) == 1.0


@pytest.mark.parametrize("factor", [0.7, 0.97, 1.04, 1.2])
def test_scores_are_those_of_the_definition(case, factor):
    depth, label = case
    random = np.random.default_rng(3)
    submitted = np.float32(depth * factor * (1 + 0.03 * random.standard_normal(depth.shape)))
    ours = found(depth, submitted, np.where(label == 0, 0, -1).astype(np.int32))[0]
    precision, recall, f1 = brute_force.score(depth, submitted, label, RASTER, FIVE)
    assert (ours.precision, ours.recall) == (precision, recall)
    assert ours.f1 == pytest.approx(f1, abs=1e-15)


def test_precision_and_recall_are_not_swapped():
    label = np.zeros((8, 8), np.int32)
    raster = Raster(fx=8, fy=8, cx=4, cy=4, width=8, height=8)
    reference = np.full((8, 8), 2.0, np.float32)
    half = reference.copy()
    half[:, 4:] = 8.0  # half of what is submitted lies far behind
    score = found(reference, half, label, raster=raster)[0]
    assert score.precision == 0.5
    assert score.recall == 0.5  # columns beside the kept half are out of reach at 5 %
    holes = np.full((8, 8), np.inf, np.float32)
    holes[3, 3] = 2.0
    score = found(reference, holes, label, raster=raster)[0]
    assert score.precision == 1.0
    assert score.recall == 1 / 64


def test_a_point_at_exactly_tau_is_a_hit():
    """`<` for `<=` would give 0."""
    raster = Raster(fx=1.0, fy=1.0, cx=0.5, cy=0.5, width=1, height=1)
    label = np.zeros((1, 1), np.int32)
    exact = Tolerance(name="half", absolute_m=0.5)
    reference, submitted = np.float32([[2.0]]), np.float32([[2.5]])
    assert found(reference, submitted, label, exact, raster)[0].f1 == 1.0
    beyond = np.nextafter(submitted, np.float32(3))
    assert found(reference, beyond, label, exact, raster)[0].f1 == 0.0


def test_nothing_in_common_is_zero_and_no_division():
    raster = Raster(fx=4.0, fy=4.0, cx=2, cy=2, width=4, height=4)
    label = np.zeros((4, 4), np.int32)
    near, far = np.full((4, 4), 1, np.float32), np.full((4, 4), 9, np.float32)
    nothing = np.full((4, 4), np.inf, np.float32)
    assert found(near, far, label, raster=raster)[0].f1 == 0.0
    assert found(near, nothing, label, raster=raster)[0] == Score(
        n_reference=16, n_submitted=0, reference_hits=0, submitted_hits=0
    )
    assert found(near, nothing, label, raster=raster)[0].f1 == 0.0
    assert mean_f1(found(nothing, near, label, raster=raster)) is None  # not eligible


def test_an_object_without_reference_points_is_not_averaged():
    eligible = Score(n_reference=4, n_submitted=4, reference_hits=4, submitted_hits=4)
    never_seen = Score(n_reference=0, n_submitted=7, reference_hits=0, submitted_hits=0)
    missed = Score(n_reference=4, n_submitted=0, reference_hits=0, submitted_hits=0)
    assert mean_f1([eligible, never_seen]) == 1.0
    assert mean_f1([eligible, never_seen, missed]) == 0.5


def test_tau_is_that_of_the_exact_nearest_even_where_a_farther_one_has_a_larger():
    """A submitted point near a close reference point and in reach of a deep one is a miss."""
    raster = Raster(fx=10.0, fy=10.0, cx=1.0, cy=0.5, width=2, height=1)
    label = np.zeros((1, 2), np.int32)
    reference = np.float32([[1.0, 20.0]])  # tau 0.05 and 1.0
    submitted = np.float32([[1.2, np.inf]])
    score = found(reference, submitted, label, raster=raster)[0]
    assert score.submitted_hits == 0
    inside = np.float32([[1.04, np.inf]])
    assert found(reference, inside, label, raster=raster)[0].submitted_hits == 1


def test_tau_follows_planar_depth_not_distance():
    raster = Raster(fx=1.0, fy=1.0, cx=-1.5, cy=0.5, width=1, height=1)  # x = 2 z
    label = np.zeros((1, 1), np.int32)
    z = np.float32(4.0)
    ray = np.sqrt(5.0)
    inside = np.float32([[z * (1 + 0.049 / ray)]])
    outside = np.float32([[z * (1 + 0.051 / ray)]])
    reference = np.float32([[z]])
    assert found(reference, inside, label, raster=raster)[0].f1 == 1.0
    assert found(reference, outside, label, raster=raster)[0].f1 == 0.0


def test_scale_about_the_camera_passes_at_the_centre_before_the_corner():
    """1 + e moves a point by e z sqrt(1 + x^2 + y^2)."""
    raster = picture_raster((90, 90), 90.0, (45, 45))
    label = np.full((45, 45), -1, np.int32)
    label[22, 22], label[0, 0] = 0, 1
    reference = np.full((45, 45), 2.0, np.float32)
    centre, corner = found(reference, reference * np.float32(1.0499), label, raster=raster)
    assert (centre.f1, corner.f1) == (1.0, 0.0)
    centre, corner = found(reference, reference * np.float32(1.0501), label, raster=raster)
    assert (centre.f1, corner.f1) == (0.0, 0.0)
    corner = found(reference, reference * np.float32(1 + 0.0499 / np.sqrt(3)), label,
                   raster=raster)[1]  # fmt: skip
    assert corner.f1 == 1.0


def test_wider_tolerances_never_score_less(case):
    depth, label = case
    random = np.random.default_rng(0)
    submitted = depth * np.float32(1 + 0.05 * random.standard_normal(depth.shape))
    by_tolerance = [
        found(depth, submitted, label, Tolerance(name="t", relative=t)) for t in (0.02, 0.05, 0.1)
    ]
    for two, five, ten in zip(*by_tolerance, strict=True):
        assert two.f1 <= five.f1 <= ten.f1
        assert two.recall <= five.recall <= ten.recall


def test_surface_in_front_of_an_object_lowers_precision_and_a_hole_does_too(case):
    depth, label = case
    object_id = int(np.argmax(np.bincount(label[label >= 0])))
    rows, columns = np.nonzero(label == object_id)
    some = rows[: len(rows) // 3], columns[: len(rows) // 3]
    before = depth.copy()
    before[some] *= 0.5
    through = depth.copy()
    through[some] *= 2.0
    clean = found(depth, depth, label)[object_id]
    for changed in (before, through):
        score = found(depth, changed, label)[object_id]
        assert score.precision < clean.precision
        assert score.recall < clean.recall


def test_what_lies_outside_every_scored_mask_does_not_enter(case):
    depth, label = case
    elsewhere = np.where(label < 0, np.float32(0.4), depth)
    assert found(depth, elsewhere, label) == found(depth, depth, label)


def test_names_and_order_of_objects_change_nothing(case):
    depth, label = case
    n = int(label.max()) + 1
    order = np.random.default_rng(1).permutation(n)
    renamed = np.where(label >= 0, order[np.maximum(label, 0)], -1).astype(np.int32)
    submitted = depth * np.float32(1.03)
    ours, theirs = found(depth, submitted, label), found(depth, submitted, renamed)
    assert [theirs[order[k]] for k in range(n)] == ours


def test_two_clouds_without_a_raster_are_scored_alike(case):
    depth, label = case
    submitted = np.float32(depth * 1.04)
    g, q = (points_m(d, RASTER)[finite_points(d)] for d in (depth, submitted))
    pairs = match_clouds(g, label[finite_points(depth)], q, label[finite_points(submitted)])
    n = int(label.max()) + 1
    assert scores(pairs, n, FIVE) == found(depth, submitted, label)


def test_a_point_s_pixel_is_the_one_that_contains_it(case):
    depth, _ = case
    kept = finite_points(depth)
    pixel = point_pixels(points_m(depth, RASTER)[kept], RASTER)
    np.testing.assert_array_equal(pixel, np.flatnonzero(kept))
    outside = [[0, 0, -1], [50, 0, 1], [0, -9, 1], [np.nan, 0, 1], [1, 0, 0], [0, 0, 0]]
    assert point_pixels(np.array(outside, float), RASTER).tolist() == [-1] * 6


def test_the_full_size_pixels_that_contain_the_raster_s_centres():
    rows, columns = containing_pixels((9, 7), replace(RASTER, width=3, height=2))
    assert (rows.tolist(), columns.tolist()) == ([1, 5], [1, 4, 7])


def test_claimed_rows_are_integers_over_their_points(case):
    """Precision x n and recall x n of any object are integers: a check of any published row."""
    depth, label = case
    for score in found(depth, depth * np.float32(1.045), label):
        assert (score.recall * score.n_reference) == pytest.approx(score.reference_hits, abs=1e-9)
        assert (score.precision * score.n_submitted) == pytest.approx(score.submitted_hits)
