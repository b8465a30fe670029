"""Acceptance against what was: residuals before and after an edit, judged by each rule."""

from __future__ import annotations

import math
from typing import Any

import pytest

from legoworld.plugin.acceptance import (
    acceptance_rule,
    blocks,
    closeness,
    list_worse,
    mean_closeness,
)
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_requirements import Requirement, Result

OVERLAP = kinds.Overlap(entity="cup", region="cup")
CENTROID = kinds.Centroid(entity="cup", region="cup")
EXTENT = kinds.Extent(entity="cup", region="cup")
DEPTH = kinds.Depth(entity="cup", matched=(("cup", "cup"),))
SUPPORT = kinds.Support(entity="cup")


def make_result(requirement: Requirement, residual: float | None) -> Result:
    tolerance = 0.5 if isinstance(requirement, kinds.Overlap) else 0.02
    passed = residual is not None and residual <= tolerance
    return Result(
        requirement=requirement,
        verdict="unknown" if residual is None else "pass" if passed else "fail",
        measurement=residual,
        residual=residual,
        tolerance=tolerance,
    )


def worse(
    requirements: list[Any], before: list[float | None], after: list[float | None], declared: int
) -> list[Any]:
    results = [
        [make_result(r, v) for r, v in zip(requirements, values, strict=True)]
        for values in (before, after)
    ]
    return [w.requirement for w in list_worse(*results, declared)]


def test_what_is_true_of_the_world_passes_and_what_fits_the_picture_is_judged_together() -> None:
    assert acceptance_rule(SUPPORT) == "passes"
    assert acceptance_rule(OVERLAP) == "together"
    assert acceptance_rule(kinds.Overlap(entity="cup", region="cup", accept="passes")) == "passes"


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ([0.4, 0.10, 0.02], [0.3, 0.05, 0.02], []),
        ([0.4, 0.10, 0.02], [0.4, 0.10, 0.02], []),
        ([0.4, 0.10, 0.02], [0.6, 0.05, 0.02], [OVERLAP]),
        ([0.4, 0.10, 0.02], [0.3, 0.12, 0.02], []),
        ([0.4, 0.10, 0.02], [0.4, 0.12, 0.02], [CENTROID]),
        ([0.4, 0.10, 0.02], [0.3, 0.05, 0.04], [DEPTH]),
        ([0.4, 0.10, 0.04], [0.5, 0.10, 0.02], []),
        ([1.0, 0.10, None], [1.0, 0.08, None], []),
        ([1.0, 0.08, None], [1.0, 0.10, None], [CENTROID]),
        ([None, None, None], [0.9, 0.5, 0.9], []),
        ([0.4, 0.10, 0.02], [None, None, None], [OVERLAP, CENTROID, DEPTH]),
    ],
)
def test_an_entity_must_not_be_less_close(
    before: list[float | None], after: list[float | None], said: list[Any]
) -> None:
    """By IoU and depth; the rest decides where these do not."""
    assert worse([OVERLAP, CENTROID, DEPTH], before, after, 3) == said


def test_closeness_is_iou_and_depth_in_tolerances_and_without_an_iou_the_mean_of_the_rest() -> None:
    assert closeness([make_result(OVERLAP, 0.25)]) == 0.75
    assert closeness([make_result(OVERLAP, 0.25), make_result(DEPTH, 0.04)]) == 0.75 * math.exp(-2)
    assert closeness([make_result(CENTROID, 0.02), make_result(EXTENT, 0.06)]) == math.exp(-2)
    assert closeness([make_result(OVERLAP, 0.0), make_result(DEPTH, 0.0)]) == 1
    other = kinds.Overlap(entity="table", region="table")
    some = [make_result(OVERLAP, 0.25), make_result(SUPPORT, 9.0), make_result(other, 0.75)]
    assert mean_closeness(some) == 0.5
    assert mean_closeness([make_result(SUPPORT, 0.0)]) == 0


def test_a_move_towards_its_place_is_accepted_far_from_any_tolerance() -> None:
    """Today's tolerances refused two good edits in three."""
    far, nearer = make_result(CENTROID, 0.3), make_result(CENTROID, 0.15)
    assert (far.verdict, nearer.verdict) == ("fail", "fail")
    assert not list_worse([far], [nearer], 1)
    assert not blocks(nearer)


@pytest.mark.parametrize(
    ("accept", "same", "lower", "higher"),
    [("improves", True, False, True), ("not_worse", False, False, True)],
)
def test_a_requirement_that_says_how_it_is_accepted_stands_alone(
    accept: Any, same: bool, lower: bool, higher: bool
) -> None:
    one = kinds.Support(entity="cup", accept=accept)
    for value, said in ((0.5, same), (0.4, lower), (0.6, higher)):
        assert bool(worse([one], [0.5], [value], 1)) is said
        assert not blocks(make_result(one, value)), "whatever its tolerance says"


def test_the_unknown_blocks_and_the_soft_never() -> None:
    assert blocks(make_result(OVERLAP, None))
    assert blocks(make_result(SUPPORT, 0.1))
    assert not blocks(make_result(OVERLAP, 0.9))
    soft = kinds.Overlap(entity="cup", region="cup", hard=False)
    assert not blocks(make_result(soft, None))
    assert worse([soft], [0.1], [0.9], 1) == []


def test_what_earlier_edits_required_of_others_is_not_broken() -> None:
    other = kinds.Overlap(entity="table", region="table")
    stands = kinds.Support(entity="table")
    asked = [OVERLAP, other, stands]
    assert worse(asked, [0.4, 0.2, 0.0], [0.3, 0.2, 0.01], 1) == []
    assert worse(asked, [0.4, 0.2, 0.0], [0.3, 0.2, 0.5], 1) == [stands]
    assert worse(asked, [0.4, 0.2, 0.5], [0.3, 0.2, 0.9], 1) == [], "it did not stand before"
    both = kinds.Overlap(entity="table", region="table", accept="passes")
    assert worse([OVERLAP, both], [0.4, 0.2], [0.3, 0.6], 1) == [both]


def test_others_count_half_and_by_what_is_seen_of_them() -> None:
    other = kinds.Overlap(entity="table", region="table")
    away = kinds.Depth(entity="table", matched=(("table", "table"),))
    assert worse([OVERLAP, other], [0.4, 0.2], [0.3, 0.39], 1) == [], "0.1 for a half of 0.19"
    assert worse([OVERLAP, other], [0.4, 0.2], [0.3, 0.41], 1) == [other]
    assert worse([OVERLAP, other], [0.4, 0.2], [0.41, 0.1], 1) == [], "what it hid is seen"
    assert worse([OVERLAP, other, away], [0.4, 0.2, 0.0], [0.3, 0.2, 0.9], 1) == []
    assert worse([SUPPORT, other], [0.0, 0.2], [0.0, 0.29], 1) == [], "it may hide a little"
    assert worse([SUPPORT, other], [0.0, 0.2], [0.0, 0.31], 1) == [other]
