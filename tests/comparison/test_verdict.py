"""What an interval says, at its ends."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from legoworld.comparison.thresholds import Threshold, find_failed_thresholds
from legoworld.comparison.verdict import classify_difference


@pytest.mark.parametrize(
    ("ends", "better", "expected"),
    [
        ((0.0, 0.2), "higher", "not told apart"),
        ((-0.2, 0.0), "higher", "not told apart"),
        ((0.0, 0.0), "lower", "not told apart"),
        ((1e-12, 0.2), "higher", "better"),
        ((1e-12, 0.2), "lower", "worse"),
        ((-0.2, -1e-12), "lower", "better"),
        (None, "higher", "no interval"),
    ],
)
def test_an_interval_that_touches_zero_tells_nothing_apart(ends, better, expected):
    row = SimpleNamespace(difference=SimpleNamespace(value=0.1, ends=ends), better=better)
    assert classify_difference(row) == expected


def comparison(**gains):
    rows = [
        SimpleNamespace(metric="AP", images=images, better="higher",
                        difference=SimpleNamespace(value=gain))
        for images, gain in gains.items()
    ]  # fmt: skip
    return SimpleNamespace(pairs=[SimpleNamespace(rows=rows, baseline="other")])


@pytest.mark.parametrize(
    ("gains", "paired", "expected"),
    [
        ({"attempted": 0.1, "paired": -0.1}, True, [("paired", -0.1)]),
        ({"attempted": 0.1}, True, [("paired", None)]),  # nothing paired is not met by attempted
        ({"attempted": -0.1, "paired": 0.1}, False, [("attempted", -0.1)]),
        ({"paired": -0.1}, False, [("paired", -0.1)]),
        ({"attempted": 0.0}, False, []),  # at the threshold is met
        ({"attempted": -1e-12}, False, [("attempted", -1e-12)]),
    ],
)
def test_a_threshold_reads_the_images_it_names(gains, paired, expected):
    threshold = Threshold(metric="AP", paired=paired, least_gain=0.0)
    found = find_failed_thresholds(comparison(**gains), [threshold])
    assert [(each.images, each.gain) for each in found] == expected
