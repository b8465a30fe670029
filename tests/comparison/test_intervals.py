"""Intervals of values and of differences: by which rule, and within which limits."""

from __future__ import annotations

import numpy as np
import pytest

from legoworld.comparison.measures import IntervalRule

SPREAD = np.linspace(-0.3, 0.3, 601)


@pytest.mark.parametrize(
    ("value", "low", "high"), [(-0.2, -0.485, 0.085), (-0.9, -1.0, -0.615), (0.9, 0.615, 1.0)]
)
def test_the_interval_of_a_difference_of_fractions_stays_between_minus_one_and_one(
    value, low, high
):
    rule = IntervalRule(centred=True, unit="image")
    found = rule.interval(SPREAD + 0.05, value, least=-1.0)  # the samples' own mean does not matter
    assert (found.low, found.high) == pytest.approx((low, high))
    assert found.bootstrap_mean == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("value", "low", "high"), [(0.1, 0.0, 0.385), (0.5, 0.215, 0.785), (0.9, 0.615, 1.0)]
)
def test_the_interval_of_a_fraction_stays_between_nought_and_one(value, low, high):
    found = IntervalRule(centred=True, unit="image").interval(SPREAD, value)
    assert (found.low, found.high) == pytest.approx((low, high))


def test_intervals_of_depth_are_the_samples_own_percentiles():
    rule = IntervalRule(centred=False, unit="scene")
    for least in (0.0, -1.0):
        found = rule.interval(SPREAD + 2, 0.5, least=least)
        assert (found.low, found.high) == pytest.approx((1.715, 2.285))
        assert found.unit == "scene"


@pytest.mark.parametrize("centred", [True, False])
def test_without_samples_there_is_no_interval(centred):
    rule = IntervalRule(centred=centred, unit="image")
    assert rule.interval(None, 0.5) is None
    assert rule.interval(None, 0.5, least=-1.0) is None
