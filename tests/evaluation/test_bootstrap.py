"""Bootstrap samples against evaluating the resampled images from the start."""

from __future__ import annotations

import numpy as np
import pytest
from evaluation import reference_resampling
from evaluation.detection_runs import (
    checked,
    match_everything,
    random_predictions,
    random_truth,
)
from evaluation.reference_resampling import pair_metrics

from legoworld.errors import ShapeError, UsageError
from legoworld.evaluation.bootstrap import (
    centred_interval,
    interval,
    resample_counts,
    resampled_means,
)
from legoworld.evaluation.detection.evaluators import run_evaluator
from legoworld.evaluation.detection.ranking.resampling import resampled_metrics
from legoworld.evaluation.detection.scoring import category_frequencies


def resampled(truth, predictions, counts):
    """Truth and predictions in which an image drawn n times stands n times under new ids."""
    images, annotations, entries = [], [], []
    for image, n in zip(sorted(truth["images"], key=lambda i: i["id"]), counts, strict=True):
        for _ in range(n):
            new = len(images) + 1
            images.append({**image, "id": new})
            annotations += [
                {**a, "image_id": new, "id": len(annotations) + k + 1}
                for k, a in enumerate(
                    a for a in truth["annotations"] if a["image_id"] == image["id"]
                )
            ]
            entries += [{**p, "image_id": new} for p in predictions if p["image_id"] == image["id"]]
    return {**truth, "images": images, "annotations": annotations}, entries


@pytest.mark.parametrize("levels", [None, 2, 1])
@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_samples_equal_direct_evaluation_of_the_resampled_images(task, levels, tmp_path):
    """An image drawn twice is two images: with equal scores a b becomes a b a b."""
    truth = random_truth(task, seed=30, images=10, categories=3 if levels else 6)
    raw = random_predictions(task, truth, seed=30, levels=levels, per_image=14)
    protocol, read, predictions = checked(tmp_path, task, truth, raw)
    problem, table = match_everything(protocol, read, predictions)
    counts = resample_counts(10, 6, seed=5)
    found = resampled_metrics(table, protocol, counts, category_frequencies(read))
    pairs = {
        aware: pair_metrics(problem, read, predictions, counts, class_aware=aware)
        for aware in (True, False)
    }
    for k, row in enumerate(counts):
        again, entries = resampled(truth, raw, row)
        protocol, read_k, predictions_k = checked(tmp_path / str(k), task, again, entries)
        scores = run_evaluator(read_k, predictions_k, protocol, "official")
        values = [np.nan_to_num(found[m.name][k], nan=-1.0) for m in protocol.metrics]
        assert values == pytest.approx(scores.official, abs=1e-12)
        problem_k, _ = match_everything(protocol, read_k, predictions_k)
        for aware, expected in pairs.items():
            whole = np.ones((1, len(again["images"])), np.int32)
            direct = pair_metrics(problem_k, read_k, predictions_k, whole, class_aware=aware)
            for name, value in direct.items():
                assert expected[name][k] == pytest.approx(value[0], abs=1e-12, nan_ok=True), name


@pytest.mark.parametrize("levels", [None, 3, 1])
@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_the_compiled_loops_are_the_plain_formulation_to_the_last_bit(task, levels, tmp_path):
    truth = random_truth(task, seed=33, images=9, categories=4)
    raw = random_predictions(task, truth, seed=33, levels=levels, per_image=14)
    protocol, read, predictions = checked(tmp_path, task, truth, raw)
    _, table = match_everything(protocol, read, predictions)
    counts, letters = resample_counts(9, 12, seed=2), category_frequencies(read)
    found = resampled_metrics(table, protocol, counts, letters)
    plain = reference_resampling.resampled_metrics(table, protocol, counts, letters)
    assert np.isfinite(found["AP"]).all()
    for name, values in plain.items():
        np.testing.assert_array_equal(found[name], values, name)


def test_counts_of_other_images_are_refused(tmp_path):
    truth = random_truth("coco", seed=33, images=9)
    made = checked(tmp_path, "coco", truth, random_predictions("coco", truth, seed=33))
    _, table = match_everything(*made)
    with pytest.raises(ShapeError, match="5 images drawn"):
        resampled_metrics(table, made[0], resample_counts(5, 3, seed=0))


def test_the_number_of_threads_and_of_draws_changes_no_bit(tmp_path, monkeypatch):
    truth = random_truth("coco", seed=31)
    protocol, read, predictions = checked(
        tmp_path, "coco", truth, random_predictions("coco", truth, seed=31)
    )
    _, table = match_everything(protocol, read, predictions)
    counts = resample_counts(12, 50, seed=0)
    whole = resampled_metrics(table, protocol, counts)
    monkeypatch.setattr("legoworld.workers.processors._MOST_THREADS", 1)
    alone = resampled_metrics(table, protocol, counts)
    parts = [resampled_metrics(table, protocol, counts[k : k + 1]) for k in range(50)]
    for name, values in whole.items():
        np.testing.assert_array_equal(values, alone[name])
        np.testing.assert_array_equal(values, np.concatenate([p[name] for p in parts]))


def test_draws_are_seeded_and_more_extend_fewer():
    few, many = resample_counts(9, 5, seed=1), resample_counts(9, 50, seed=1)
    np.testing.assert_array_equal(few, many[:5])
    assert (many.sum(axis=1) == 9).all()
    assert (resample_counts(9, 50, seed=2) != many).any()
    with pytest.raises(UsageError):
        resample_counts(0, 5, seed=1)


def test_means_weigh_groups_as_often_as_they_are_drawn():
    counts = np.array([[2, 0, 1], [0, 0, 3], [0, 3, 0]], np.int32)
    values, groups = np.array([1.0, 3.0, 10.0]), np.array([0, 0, 2])
    means = resampled_means(values, groups, counts)
    assert means[0] == pytest.approx((2 * 4 + 10) / 5)
    assert means[1] == pytest.approx(10)
    assert np.isnan(means[2])


def test_intervals():
    samples = np.linspace(0.4, 0.6, 2001)
    plain = interval(samples, unit="image")
    assert (plain.low, plain.high) == pytest.approx((0.405, 0.595))
    centred = centred_interval(samples, 0.3, unit="image")
    assert (centred.low, centred.high) == pytest.approx((0.205, 0.395))
    assert centred.bootstrap_mean == pytest.approx(0.5)
    assert centred_interval(samples, 0.95, unit="image").high == 1.0
    nothing = centred_interval(np.full(5, np.nan), np.nan, unit="image")
    assert nothing.low is None
    assert nothing.undefined_draws == 5
    assert centred_interval(samples, np.nan, unit="image").low is None


def test_the_interval_of_an_average_precision_holds_its_value(tmp_path):
    """Its samples lie above it: a percentile interval could leave the value out."""
    truth = random_truth("coco", seed=32, images=40, categories=30, per_image=3)
    protocol, read, predictions = checked(
        tmp_path, "coco", truth, random_predictions("coco", truth, seed=32)
    )
    _, table = match_everything(protocol, read, predictions)
    samples = resampled_metrics(table, protocol, resample_counts(40, 400, seed=0))["AP"]
    value = run_evaluator(read, predictions, protocol, "fast").official[0]
    found = centred_interval(samples, value, unit="image")
    assert found.bootstrap_mean > value + samples.std() / 4
    assert found.low < value < found.high


@pytest.mark.parametrize("n_groups", [1, 2, 3, 26, 700])
def test_samples_drawn_in_blocks_are_those_of_a_call_for_each(n_groups):
    """And more draws extend fewer; 700 groups take two blocks."""
    random = np.random.default_rng([4, n_groups])
    expected = np.array(
        [
            np.bincount(random.integers(0, n_groups, n_groups), minlength=n_groups)
            for _ in range(400)
        ]
    )
    counts = resample_counts(n_groups, 400, seed=4)
    assert counts.dtype == np.int32
    assert np.array_equal(counts, expected)
    assert np.array_equal(resample_counts(n_groups, 90, seed=4), expected[:90])
