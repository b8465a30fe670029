"""Whether an edit may stay by its residuals: against its tolerances, or against what they were.

What is true of the world by itself has to pass (a cup stands, or it does not). How well a picture
fits is relative: an edit that brings a chair half-way to its place is a good one. docs/plugin.md
has the experiment that chose the rule.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Literal

from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_ledger import Worse
from legoworld.records.plugin_requirements import Requirement, Result

#: Kinds that say how well the picture fits.
_RELATIVE: Final = (
    kinds.Centroid,
    kinds.Extent,
    kinds.Overlap,
    kinds.Boundary,
    kinds.Depth,
    kinds.DepthOrder,
    kinds.Luminance,
)
#: Residuals of one scene, computed twice, differ by less.
_SAME: Final = 1e-9
#: What an edit may cost the IoU of an object that it was not about: it may hide it.
_OTHERS_IOU: Final = 0.05


def rule_of(requirement: Requirement) -> Literal["passes", "improves", "not_worse", "together"]:
    """How a requirement is accepted: as it says, else by its kind."""
    if requirement.accept is not None:
        return requirement.accept
    return "together" if isinstance(requirement, _RELATIVE) else "passes"


def blocks(result: Result) -> bool:
    """Whether a result blocks whatever was before: it has to pass, or nothing is known of it."""
    requirement = result.requirement
    if not requirement.hard or result.verdict == "pass":
        return False
    return rule_of(requirement) == "passes" or result.verdict == "unknown"


def list_worse(
    before: Sequence[Result], after: Sequence[Result], n_declared: int
) -> tuple[Worse, ...]:
    """What an edit made worse and its rule does not allow, in the order of the requirements.

    before, after: of the same requirements, the first `n_declared` the edit's own; the rest are
    those of earlier edits, which it must not break.
    """
    pairs = list(zip(before, after, strict=True))
    own, others = pairs[:n_declared], pairs[n_declared:]
    worse = [*_alone(own), *_together(own), *_broken(others)]
    order = {id(b): k for k, (b, _) in enumerate(pairs)}
    return tuple(
        Worse(requirement=a.requirement, before=b.residual, after=a.residual)
        for b, a in sorted(worse, key=lambda pair: order[id(pair[0])])
    )


Pair = tuple[Result, Result]


def _alone(pairs: Iterable[Pair]) -> Iterator[Pair]:
    """Those that say themselves what they want."""
    for b, a in pairs:
        rule = rule_of(a.requirement)
        rise = _rise(b, a)
        if a.requirement.hard and (
            (rule == "not_worse" and rise > 0) or (rule == "improves" and rise >= 0)
        ):
            yield b, a


def _together(pairs: Iterable[Pair]) -> Iterator[Pair]:
    """Those of an entity whose IoU falls, or more of whose residuals rise than fall."""
    by_entity: dict[object, list[Pair]] = {}
    for b, a in pairs:
        if a.requirement.hard and rule_of(a.requirement) == "together":
            about = getattr(a.requirement, "entity", None)
            by_entity.setdefault(about or a.requirement, []).append((b, a))
    for some in by_entity.values():
        signs = [_rise(b, a) for b, a in some]
        overlap = any(
            isinstance(a.requirement, kinds.Overlap) and sign > 0
            for (_, a), sign in zip(some, signs, strict=True)
        )
        if overlap or sum(signs) > 0:
            yield from (pair for pair, sign in zip(some, signs, strict=True) if sign > 0)


def _broken(pairs: Iterable[Pair]) -> Iterator[Pair]:
    """Of earlier edits: what passed and does not, and an IoU that falls by more than a little."""
    for b, a in pairs:
        if not a.requirement.hard:
            continue
        if isinstance(a.requirement, kinds.Overlap) and rule_of(a.requirement) == "together":
            if _value(a) - _value(b) > _OTHERS_IOU:
                yield b, a
        elif rule_of(a.requirement) != "together" and b.verdict == "pass" != a.verdict:
            yield b, a


def _rise(before: Result, after: Result) -> int:
    """1 where a residual rises, -1 where it falls, 0 where it is the same."""
    b, a = _value(before), _value(after)
    if a == b or abs(a - b) <= _SAME:
        return 0
    return 1 if a > b else -1


def _value(result: Result) -> float:
    """The residual; what cannot be measured, and what fails without a number, is the worst."""
    return math.inf if result.residual is None else result.residual
