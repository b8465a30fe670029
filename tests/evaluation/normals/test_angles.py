"""Angular errors by hand: thresholds, holes, pooling over images."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies

from legoworld.evaluation.normals.arrays import NormalsArray
from legoworld.evaluation.normals.pooling import MEDIAN, Middle, _is_within, own_fields
from legoworld.evaluation.normals.protocol import (
    angular_errors,
    bin_errors,
    image_metrics,
    sum_errors,
)
from legoworld.evaluation.pixels.family import Settings
from legoworld.evaluation.pixels.resampling import sampler

VECTOR = np.array([0, 5, 7.5, 11.25, 22.5, 30])
SHARES = ["below_5", "below_7_5", "below_11_25", "below_22_5", "below_30"]


def same_metrics(found, expected):
    for name, by_policy in expected.items():
        assert found[name] == pytest.approx(by_policy, abs=1e-12), name


def test_the_six_errors_of_the_specification():
    metrics = image_metrics(VECTOR, sum_errors(VECTOR), holes=0)
    assert metrics["mean_deg"]["exclude"] == pytest.approx(12.708333, abs=5e-7)
    assert metrics["median_deg"]["exclude"] == 9.375
    assert metrics["rmse_deg"]["exclude"] == pytest.approx(16.401537, abs=5e-7)
    assert [metrics[name]["exclude"] for name in SHARES] == [k / 6 for k in range(1, 6)]
    assert metrics["mean_deg"]["error_90"] == metrics["mean_deg"]["exclude"]


def test_a_hole_is_left_out_or_90_degrees_or_in_no_share():
    metrics = image_metrics(VECTOR, sum_errors(VECTOR), holes=1)
    assert metrics["mean_deg"]["error_90"] == pytest.approx((76.25 + 90) / 7)
    assert metrics["median_deg"] == {"error_90": 11.25, "exclude": 9.375}
    rmse = np.sqrt((np.square(VECTOR).sum() + 8100) / 7)
    assert metrics["rmse_deg"]["error_90"] == pytest.approx(rmse)
    assert [metrics[name]["fails"] for name in SHARES] == [k / 7 for k in range(1, 6)]
    assert [metrics[name]["exclude"] for name in SHARES] == [k / 6 for k in range(1, 6)]


def rows_of(images, holes):
    """The rows of images of errors, with holes in the first."""
    return [
        SimpleNamespace(errors=sum_errors(e), n_valid=len(e) + (0 if k else holes))
        for k, e in enumerate(images)
    ]


def pooled_metrics(images, rows, order=1):
    """Images of errors and their rows, as two readings of their arrays pool them."""
    asked = MEDIAN.question(rows)["bins"]
    answers = [e[np.isin(bin_errors(e), asked)] for e in images]
    options = MEDIAN.conclude(rows, answers[::order])
    return own_fields(rows, rows, Settings(options=options, draws=1, seed=0))["pooled"]


@pytest.mark.parametrize("holes", [0, 1, 5])
def test_pooled_images_are_one_image_of_all_pixels(holes):
    errors = np.random.default_rng(0).uniform(0, 180, 501)
    whole = image_metrics(errors, sum_errors(errors), holes)
    parts = np.split(errors, [1, 200, 201])
    same_metrics(pooled_metrics(parts, rows_of(parts, holes)), whole)
    one = pooled_metrics([VECTOR], rows_of([VECTOR], 0))
    same_metrics(one, image_metrics(VECTOR, sum_errors(VECTOR), 0))


@settings(max_examples=60)
@given(
    values=strategies.lists(
        strategies.floats(0, 180) | strategies.floats(89.99, 90.01), min_size=1
    ),
    holes=strategies.integers(0, 9),
    seed=strategies.integers(0, 99),
)
@example(values=[90.0, 90.0, 89.999], holes=3, seed=0)
def test_the_pooled_median_is_exact_in_any_order(values, holes, seed):
    errors = np.array(values)
    parts = np.split(errors, np.sort(np.random.default_rng(seed).integers(0, len(errors), 2)))
    rows = rows_of(parts, holes)
    medians = pooled_metrics(parts, rows)["median_deg"]
    assert medians == pooled_metrics(parts, rows, order=-1)["median_deg"]
    assert medians["exclude"] == np.median(errors)
    assert medians["error_90"] == np.median(np.concatenate([errors, np.full(holes, 90.0)]))


def test_a_median_lies_in_the_hundredth_that_its_counts_name():
    middle = Middle(bins=(150, 150), ranks=(0, 0), holes=0)  # [1.495, 1.505)
    assert [_is_within(x, middle) for x in (1.494, 1.495, 1.5, 1.505, 1.506)] == [
        False, True, True, True, False,
    ]  # fmt: skip
    assert _is_within(2.0, Middle(bins=(100, 300), ranks=(0, 0), holes=0))


def test_counts_are_packed_and_end_with_the_largest_error():
    assert sum_errors(np.array([0.0, 0.02, 0.02, 0.05])).counts == (1, -1, 2, -2, 1)
    assert sum_errors(np.array([180.0])).counts == (-18000, 1)


def angled(degrees: np.ndarray) -> np.ndarray:
    """(1, n, 3) vectors, so many degrees from (0, 0, -1)."""
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=-1)[None]


@pytest.mark.parametrize("sign", ["towards_camera", "away_from_camera"])
@pytest.mark.parametrize("length", [0.6, 1.0, 7.0])
def test_errors_do_not_depend_on_length_or_stated_sign(sign, length):
    values = angled(VECTOR) * length * (1 if sign == "towards_camera" else -1)
    sample = sampler(NormalsArray(values=values, sign=sign), (6, 1))
    truth = angled(np.zeros(6)).astype(np.float32)
    assert angular_errors(truth, sample, 6) == pytest.approx(VECTOR, abs=2e-6)
    assert angular_errors(-truth, sample, 6) == pytest.approx(180 - VECTOR, abs=2e-6)


def test_short_and_unknown_vectors_are_holes_in_prediction_and_truth():
    values = angled(VECTOR)
    values[0, 0] = np.nan
    values[0, 1] *= 0.5
    values[0, 2] = np.inf
    truth = angled(np.zeros(6))
    truth[0, 5] = 0
    sample = sampler(NormalsArray(values=values, sign="towards_camera"), (6, 1))
    assert angular_errors(truth, sample, 5) == pytest.approx(VECTOR[3:5], abs=2e-6)


def test_a_smaller_prediction_is_interpolated_and_renormalised():
    values = angled(np.array([0.0, 60.0]))
    sample = sampler(NormalsArray(values=values, sign="towards_camera"), (4, 2))
    errors = angular_errors(np.repeat(angled(np.zeros(4)), 2, axis=0), sample, 8)
    quarter = np.degrees(np.arctan2(np.sqrt(3) / 8, 0.75 + 0.125))
    assert errors[:4] == pytest.approx([0, quarter, 60 - quarter, 60], abs=2e-6)
