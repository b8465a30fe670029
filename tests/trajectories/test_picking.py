"""Which checkpoint `trajectory pick --by residuals` takes: the last, or a clearly better one."""

from __future__ import annotations

import random

import pytest
from trajectories.requirement_reports import report

from legoworld.trajectories.clearly_better import CLEARLY, clearly_best, lead


def test_one_scene_is_the_best_of_one():
    assert clearly_best([report([3.0] * 5)]) == 0


def test_equal_scenes_leave_the_last():
    assert clearly_best([report([1.0] * 8)] * 4) == 3


@pytest.mark.parametrize(("better", "taken"), [(3, 1), (4, 0), (20, 0)])
def test_four_requirements_that_agree_are_needed(better, taken):
    before = [0.9] * better + [2.0] * (20 - better)
    assert clearly_best([report(before), report([2.0] * 20)]) == taken


def test_requirements_that_disagree_leave_the_last():
    before, after = [0.5] * 10 + [3.0] * 7 + [0.5] * 3, [3.0] * 7 + [0.5] * 13
    assert clearly_best([report(before), report(after)]) == 1


def test_an_unknown_is_never_better_and_a_lost_object_counts():
    known, lost = report([0.5] * 20), report([None] * 6 + [0.5] * 14)
    assert clearly_best([lost, known]) == 1
    assert clearly_best([known, lost]) == 0
    failing = report([5.0] * 20)
    assert clearly_best([report([None] * 20), failing]) == 1
    assert clearly_best([failing, report([None] * 20)]) == 1


def test_of_several_the_clearest_and_of_equals_the_later():
    worse, good, better = report([9.0] * 20), report([0.5] * 9 + [9.0] * 11), report([1.0] * 20)
    assert clearly_best([good, better, better, good, worse]) == 2


def test_a_lead_is_the_other_s_lag_and_is_bounded():
    draw = random.Random(0)
    for _ in range(200):
        one, other = (
            report([draw.choice([None, draw.uniform(0, 12)]) for _ in range(20)]) for _ in "ab"
        )
        forth, back = lead(one.results, other.results), lead(other.results, one.results)
        assert forth == -back
        assert abs(forth) <= 20**0.5
        assert lead(one.results, one.results) == 0
        assert (clearly_best([one, other]) == 0) == (forth >= CLEARLY)
