"""Tie orders against every order there is."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from evaluation import reference_resampling
from evaluation.detection_runs import (
    checked,
    match_everything,
    random_predictions,
    random_truth,
)
from hypothesis import example, given, settings
from strategies import rankings

from legoworld.evaluation.detection.matching.outcomes import (
    MatchTable,
)
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.ranking.compiled_accumulation import (
    ordered_precision,
    pack_bits,
)
from legoworld.evaluation.detection.ranking.ties import (
    _ranking,
    order_aps,
    random_orders,
    tie_orders,
)

COCO = detection_protocol("coco")


def table_of(states, scores, n_truths):
    """One category in one image. states: (T, D) or (D,) for all thresholds alike."""
    states = np.array(states, np.uint8)
    states = np.broadcast_to(states, (4, 10, states.shape[-1])).copy()
    n = states.shape[-1]
    zeros = np.zeros(n, np.int64)
    return MatchTable(
        image_ids=np.array([1]),
        category_ids=np.array([1]),
        image=zeros,
        category=zeros,
        score=np.array(scores, np.float64),
        rank=np.arange(n),
        entry=np.arange(n),
        state=states,
        truth_image=np.array([0]),
        truth_category=np.array([0]),
        n_truths=np.full((4, 1), n_truths),
    )


def ap(table):
    return metric_value(COCO.metrics[0], accumulate(table, COCO))


def all_orders(table):
    """AP of every order that leaves scores falling, each order of each tied run once.

    Orders that differ only in which of two equal predictions comes first are evaluated once.
    """
    runs = [list(g) for _, g in itertools.groupby(range(len(table.score)), table.score.__getitem__)]
    columns = [table.state[:, :, d].tobytes() for d in range(len(table.score))]
    found = {}
    values = []
    for choice in itertools.product(*(itertools.permutations(run) for run in runs)):
        order = [i for run in choice for i in run]
        outcome = tuple(columns[i] for i in order)
        if outcome not in found:
            found[outcome] = ap(replace(table, state=table.state[:, :, order]))
        values.append(found[outcome])
    return np.array(values)


CASES = (
    ([1, 0, 1, 0, 0, 1], [1.0] * 6, 4),  # all equal
    ([0, 1, 0, 1, 0, 1], [0.9, 0.9, 0.9, 0.2, 0.2, 0.2], 3),  # two runs
    ([0, 1, 0, 1, 0, 1], [0.9, 0.8, 0.7, 0.6, 0.5, 0.4], 3),  # no ties
    ([1, 1, 0, 0, 0, 0], [0.9, 0.9, 0.2, 0.2, 0.2, 0.2], 2),  # true above, false below
    ([2, 1, 0, 2, 0, 1], [1.0] * 6, 3),  # ignored
    ([0, 0, 2], [1.0] * 3, 3),  # none true
    ([0, 0, 0, 1, 0, 0, 0], [1.0] * 7, 1),  # one true of many
)


def every_case(law):
    """The cases written out, beside what is drawn."""
    for case in CASES:
        law = example(case)(law)
    return law


@settings(max_examples=8)
@given(rankings(most=6))
@every_case
def test_expectation_and_spread_are_those_of_all_orders(ranking):
    """Five standard errors, of the mean and of the variance."""
    table = table_of(*ranking)
    every = all_orders(table)
    draws = 20_000
    result = tie_orders(table, draws=draws, seed=3)
    assert result.expected == pytest.approx(
        every.mean(), abs=5 * every.std() / np.sqrt(draws) + 1e-12
    )
    fourth = ((every - every.mean()) ** 4).mean()
    error = np.sqrt(max(fourth - every.var() ** 2, 0) / draws)
    of_the_mean = 26 * every.var() / draws  # the sample's mean is five of its own errors away
    assert result.sd**2 == pytest.approx(every.var(), abs=5 * error + of_the_mean + 1e-12)
    assert result.worst <= every.min() + 1e-12
    assert result.best >= every.max() - 1e-12
    if (table.state == table.state[:, :1]).all():  # as at every threshold: bounds are reached
        assert result.worst == pytest.approx(every.min(), abs=1e-12)
        assert result.best == pytest.approx(every.max(), abs=1e-12)


def test_the_bounds_of_equal_confidence_are_precision_times_recall_and_recall():
    """2 of 3 truths found among 8: P = 1/4; 67 of the 101 recall thresholds are reached."""
    result = tie_orders(table_of([1, 1, 0, 0, 0, 0, 0, 0], [1.0] * 8, 3), draws=2, seed=0)
    assert result.worst == pytest.approx(67 / 101 / 4)
    assert result.best == pytest.approx(67 / 101)


def test_one_order_serves_all_thresholds():
    """Independent orders per threshold would shrink the spread about threefold."""
    states = np.tile(np.array([1, 0, 0, 0, 1, 0]), (10, 1))
    shared = tie_orders(table_of(states, [1.0] * 6, 2), draws=4000, seed=0)
    alone = all_orders(table_of(states, [1.0] * 6, 2))
    assert shared.sd == pytest.approx(alone.std(), rel=0.05)


def test_seeds_and_draws(tmp_path):
    truth = random_truth("coco", seed=20)
    _, table = match_everything(
        *checked(tmp_path, "coco", truth, random_predictions("coco", truth, seed=20, levels=2))
    )
    first = tie_orders(table, draws=300, seed=1)
    assert first == tie_orders(table, draws=300, seed=1)
    assert first.expected != tie_orders(table, draws=300, seed=2).expected
    assert first.n_tied > 0


def test_ties_of_a_run_against_full_evaluations_of_shuffled_results(tmp_path):
    """Matching anew in every order moves the expectation by less than the orders themselves do."""
    truth = random_truth("coco", seed=21, images=30)
    protocol, read, predictions = checked(
        tmp_path, "coco", truth, random_predictions("coco", truth, seed=21, levels=1)
    )
    _, table = match_everything(protocol, read, predictions)
    result = tie_orders(table, draws=2000, seed=0)
    random = np.random.default_rng(0)
    full = []
    image_order = {i["id"]: i for i in truth["images"]}
    for _ in range(60):
        # Order across images is by image id: only new ids change it.
        new = dict(zip(image_order, random.permutation(len(image_order)).tolist(), strict=True))
        again = {
            **truth,
            "images": [{**i, "id": new[i["id"]]} for i in truth["images"]],
            "annotations": [{**a, "image_id": new[a["image_id"]]} for a in truth["annotations"]],
        }
        entries = [{**e, "image_id": new[e["image_id"]]} for e in predictions.entries.documents()]
        _, other = match_everything(*checked(tmp_path, "coco", again, entries))
        full.append(ap_of(other))
    assert result.expected == pytest.approx(np.mean(full), abs=4 * result.sd / np.sqrt(60) + 0.01)
    assert np.std(full) == pytest.approx(result.sd, rel=0.5)


def ap_of(table):
    return metric_value(COCO.metrics[0], accumulate(table, COCO))


@pytest.mark.parametrize("many", [1, 3, 9, 150, 1000])
def test_random_orders_are_those_of_numpy_to_the_last_bit(many):
    """Runs of one to many detections, among none to many plain ones; drawn in two blocks."""
    random = np.random.default_rng(many)
    sizes = random.integers(1, many + 1, 12)
    states = np.zeros((10, 40 * int(sizes.sum())), np.uint8)
    scores = np.repeat(np.arange(12, 0, -1.0), 40 * sizes)
    special = random.random(len(scores)) < random.choice([0.01, 0.2, 1.0], 12).repeat(40 * sizes)
    states[:, special] = random.integers(0, 3, (10, int(special.sum())))
    ranking = _ranking(states, scores)
    assert ranking.has_ties
    pair = [np.random.default_rng(9) for _ in range(2)]
    for n in (7, 60):
        order, plain = random_orders(*ranking.runs, n, pair[0])
        expected = reference_resampling.random_orders(ranking, n, pair[1])
        np.testing.assert_array_equal(order, expected[0])
        np.testing.assert_array_equal(plain, expected[1])
    assert pair[0].random() == pair[1].random()


@settings(max_examples=30)
@given(rankings(most=9))
@every_case
def test_the_compiled_orders_are_the_plain_formulation_to_the_last_bit(ranking):
    table = table_of(*ranking)
    n_truths = int(table.n_truths[0, 0])
    ranking = _ranking(table.state[0], table.score)
    random = np.random.default_rng(4)
    order, plain = random_orders(*ranking.runs, 40, random)
    expected = reference_resampling.average_precision_in_orders(ranking, order, plain, n_truths)
    found = ordered_precision(
        pack_bits(ranking.true), pack_bits(~(ranking.true | ranking.false)), order, plain, n_truths
    )
    np.testing.assert_array_equal(found, expected)


def test_the_spread_is_that_of_a_sample():
    """Two draws of two orders: their standard deviation divides by one, not by two."""
    table = table_of([1, 0], [1.0, 1.0], 1)
    result = tie_orders(table, draws=2, seed=next(
        seed for seed in range(50) if np.ptp(order_aps(table, draws=2, seed=seed)) > 0
    ))  # fmt: skip
    assert result.expected == pytest.approx(0.75)
    assert result.sd == pytest.approx(0.5 / np.sqrt(2))
    assert tie_orders(table, draws=1, seed=0).sd == 0.0


def test_the_number_of_threads_changes_no_bit(tmp_path, monkeypatch):
    truth = random_truth("lvis", seed=22, images=20, categories=12)
    _, table = match_everything(
        *checked(tmp_path, "lvis", truth, random_predictions("lvis", truth, seed=22, levels=3))
    )
    whole = order_aps(table, draws=200, seed=0)
    assert whole.std() > 0
    monkeypatch.setattr("legoworld.workers.processors._MOST_THREADS", 1)
    np.testing.assert_array_equal(order_aps(table, draws=200, seed=0), whole)
