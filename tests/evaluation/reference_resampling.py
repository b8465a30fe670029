"""Bootstrap samples and tie orders in plain NumPy, one draw at a time: what compiled loops are.

Written from the definitions in docs/protocols/ties.md; slow.
"""

from __future__ import annotations

import itertools

import numpy as np

from legoworld.evaluation.detection.grid import PICTURE
from legoworld.evaluation.detection.matching.matched_metrics import matched_counts, matched_metrics
from legoworld.evaluation.detection.matching.matches import match_and_pair
from legoworld.evaluation.detection.matching.outcomes import IGNORED, TRUE_POSITIVE
from legoworld.evaluation.detection.ranking.accumulation import (
    mean_precision,
    recall_steps,
)


def copies(image, score, count):
    """Places of a category's ranking in a sample: image by image, each copy of an image whole."""
    places = []
    for (_score, i), block in itertools.groupby(
        range(len(image)), key=lambda d: (-score[d], image[d])
    ):
        places += list(block) * int(count[i])
    return np.array(places, np.int64)


def curve_precision(states, n_truths):
    """101-point AP of one ranking at one threshold. states: (D,)."""
    true = states[states != IGNORED] == TRUE_POSITIVE
    at = np.flatnonzero(true)
    n_true = np.arange(1, len(at) + 1)
    return mean_precision(n_true[None], (at + 1)[None], recall_steps(n_truths)[: len(at)][None])[0]


def mean_in_order(values):
    total = values[0]
    for value in values[1:]:
        total = total + value
    return total / len(values)


def resampled_metrics(table, protocol, counts, frequencies=None):
    """As legoworld.evaluation.detection.ranking.resampling.resampled_metrics."""
    found = {m.name: np.full(len(counts), np.nan) for m in protocol.metrics}
    slices = table.category_slices
    for draw, count in enumerate(counts):
        for metric in protocol.metrics:
            a = PICTURE.areas.index(metric.area)
            weights = table.n_truths[a] * count[table.truth_image]
            n_truths = np.bincount(table.truth_category, weights, len(slices)).astype(int)
            values = []
            for k in np.flatnonzero(n_truths):
                if metric.frequency is not None and frequencies[k] != metric.frequency:
                    continue
                rows = slices[k]
                order = copies(table.image[rows], table.score[rows], count)
                state, rank = table.state[a, :, rows][:, order], table.rank[rows][order]
                if metric.kind == "AP":
                    at = [curve_precision(states, n_truths[k]) for states in state]
                else:
                    within = rank < (metric.max_rank or np.inf)
                    at = [(s[within] == TRUE_POSITIVE).sum() / n_truths[k] for s in state]
                which = [metric.iou in (None, t) for t in PICTURE.iou]
                values.append(mean_in_order(list(itertools.compress(at, which))))
            if values:
                found[metric.name][draw] = np.array([*values, 0.0]).cumsum()[-1] / len(values)
    return found


def average_precision_in_orders(ranking, order, plain, n_truths):
    """As compiled_accumulation.ordered_precision, of ties' own ranking."""
    steps = recall_steps(n_truths)
    values = []
    for t, flags in enumerate(ranking.true):
        ignored = ~(flags | ranking.false[t])
        one = np.zeros(len(order))
        for i, places in enumerate(order):
            above = plain[i] + np.arange(1, len(places) + 1) - np.cumsum(ignored[places])
            n_all = above[flags[places]]
            n_true = np.arange(1, len(n_all) + 1)
            one[i] = mean_precision(n_true[None], n_all[None], steps[: len(n_all)][None])[0]
        values.append(one)
    return mean_in_order(values)


def pair_metrics(problem, truth, predictions, samples, *, class_aware):
    matches = match_and_pair(problem, truth, predictions)
    pairs = matches.aware if class_aware else matches.agnostic
    return matched_metrics(matched_counts(problem, pairs), samples)


def segments(values):
    """Runs of equal values."""
    bounds = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    return [slice(*pair) for pair in itertools.pairwise(bounds) if pair[0] < pair[1]]


def random_orders(ranking, n, random):
    """As random_orders.random_orders, of ties' own ranking."""
    order = np.repeat(np.arange(len(ranking.group))[None], n, axis=0)
    plain = np.repeat(ranking.plain_before[ranking.group][None], n, axis=0)
    for run in segments(ranking.group):
        n_special = run.stop - run.start
        n_plain = int(ranking.plain_in[ranking.group[run.start]])
        if n_special > 1:
            keys = random.random((n_special, n), np.float32)
            order[:, run] = run.start + np.argsort(keys, axis=0, kind="stable").T
        if n_plain:
            gaps = random.standard_exponential((n, n_special + 1))
            shares = random.multinomial(n_plain, gaps / gaps.sum(axis=1, keepdims=True))
            plain[:, run] += np.cumsum(shares[:, :-1], axis=1)
    return order, plain
