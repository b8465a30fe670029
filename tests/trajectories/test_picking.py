"""Which checkpoint `trajectory pick --by residuals` takes: the last, or a clearly closer one."""

from __future__ import annotations

import pytest
from trajectories.requirement_reports import report

from legoworld.plugin.acceptance import clearly_closest
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_requirements import Result


def take_scenes(*scenes):
    """residuals of centroids in tolerances: closeness is exp(-residual)."""
    return clearly_closest([report(residuals).results for residuals in scenes])


def test_one_scene_is_the_best_of_one_and_equal_scenes_leave_the_last():
    assert take_scenes([3.0] * 5) == 0
    assert take_scenes(*[[1.0] * 8] * 4) == 3


@pytest.mark.parametrize(("last", "expected"), [(1.3, 1), (1.4, 0), (0.9, 1)])
def test_a_tenth_of_closeness_is_needed(last, expected):
    """exp(-1) is 0.368, exp(-1.3) is 0.273, exp(-1.4) is 0.247."""
    assert take_scenes([1.0] * 5, [last] * 5) == expected


def test_an_unknown_is_never_closer_and_a_lost_object_counts():
    known, lost = [0.5] * 20, [None] * 6 + [0.5] * 14
    assert take_scenes(lost, known) == 1
    assert take_scenes(known, lost) == 0
    assert take_scenes([None] * 20, [15.0] * 20) == 1
    assert take_scenes([15.0] * 20, [None] * 20) == 1


def test_of_several_the_closest_and_of_equals_the_later():
    worse, good, better = [9.0] * 20, [0.5] * 9 + [9.0] * 11, [1.0] * 20
    assert take_scenes(good, better, better, good, worse) == 2


def test_requirements_of_the_world_alone_leave_the_last():
    def stands(residual):
        return Result(
            requirement=kinds.Support(entity="cup"), verdict="fail", measurement=residual,
            residual=residual, tolerance=0.01,
        )  # fmt: skip

    assert clearly_closest([[stands(0.0)], [stands(0.5)]]) == 1
