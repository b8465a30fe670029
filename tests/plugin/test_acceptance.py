"""Acceptance against what was: residuals before and after an edit, judged by each rule."""

from __future__ import annotations

from typing import Any

import pytest

from legoworld.plugin.acceptance import blocks, list_worse, rule_of
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_requirements import Requirement, Result

OVERLAP = kinds.Overlap(entity="cup", region="cup")
CENTROID = kinds.Centroid(entity="cup", region="cup")
EXTENT = kinds.Extent(entity="cup", region="cup")
SUPPORT = kinds.Support(entity="cup")


def found(requirement: Requirement, residual: float | None) -> Result:
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
        [found(r, v) for r, v in zip(requirements, values, strict=True)]
        for values in (before, after)
    ]
    return [w.requirement for w in list_worse(*results, declared)]


def test_what_is_true_of_the_world_passes_and_what_fits_the_picture_is_judged_together() -> None:
    assert rule_of(SUPPORT) == "passes"
    assert rule_of(OVERLAP) == "together"
    assert rule_of(kinds.Overlap(entity="cup", region="cup", accept="passes")) == "passes"


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ([0.4, 0.10, 0.3], [0.3, 0.05, 0.2], []),
        ([0.4, 0.10, 0.3], [0.4, 0.10, 0.3], []),
        ([0.4, 0.10, 0.3], [0.41, 0.05, 0.2], [OVERLAP]),
        ([0.4, 0.10, 0.3], [0.3, 0.12, 0.2], []),
        ([0.4, 0.10, 0.3], [0.4, 0.12, 0.3], [CENTROID]),
        ([0.4, 0.10, 0.3], [0.3, 0.12, 0.31], [CENTROID, EXTENT]),
        ([None, None, None], [0.9, 0.5, 0.9], []),
        ([0.4, 0.10, 0.3], [None, None, None], [OVERLAP, CENTROID, EXTENT]),
    ],
)
def test_an_entity_s_iou_must_not_fall_and_no_more_may_rise_than_fall(
    before: list[float | None], after: list[float | None], said: list[Any]
) -> None:
    assert worse([OVERLAP, CENTROID, EXTENT], before, after, 3) == said


def test_a_move_towards_its_place_is_accepted_far_from_any_tolerance() -> None:
    """Today's tolerances refused two good edits in three."""
    far, nearer = found(CENTROID, 0.3), found(CENTROID, 0.15)
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
        assert not blocks(found(one, value)), "whatever its tolerance says"


def test_the_unknown_blocks_and_the_soft_never() -> None:
    assert blocks(found(OVERLAP, None))
    assert blocks(found(SUPPORT, 0.1))
    assert not blocks(found(OVERLAP, 0.9))
    soft = kinds.Overlap(entity="cup", region="cup", hard=False)
    assert not blocks(found(soft, None))
    assert worse([soft], [0.1], [0.9], 1) == []


def test_what_earlier_edits_required_of_others_is_not_broken() -> None:
    other = kinds.Overlap(entity="table", region="table")
    stands = kinds.Support(entity="table")
    asked = [OVERLAP, other, stands]
    assert worse(asked, [0.4, 0.2, 0.0], [0.3, 0.24, 0.01], 1) == []
    assert worse(asked, [0.4, 0.2, 0.0], [0.3, 0.26, 0.0], 1) == [other], "an edit may hide a bit"
    assert worse(asked, [0.4, 0.2, 0.0], [0.3, 0.2, 0.5], 1) == [stands]
    assert worse(asked, [0.4, 0.2, 0.5], [0.3, 0.2, 0.9], 1) == [], "it did not stand before"
    both = kinds.Overlap(entity="table", region="table", accept="passes")
    assert worse([OVERLAP, both], [0.4, 0.2], [0.3, 0.6], 1) == [both]
