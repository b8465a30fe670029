"""Whether an edit may stay by its residuals: against its tolerances, or against what they were.

What is true of the world by itself has to pass (a cup stands, or it does not). How well a picture
fits is relative: an edit that brings a chair half-way to its place is a good one. It is summed up
as closeness, which also tells which of several scenes fits best. docs/plugin.md has the experiments
that chose the rule.
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
    kinds.Colour,
)
#: Closenesses of one scene, computed twice, differ by less.
_SAME: Final = 1e-9
#: What another entity's closeness counts against that of an entity an edit is about.
_OTHERS: Final = 0.5
#: What an edit that requires nothing of the picture may cost the others, all together.
_HIDDEN: Final = 0.05
#: An IoU of less, and more tolerances than this, are no worse: what cannot be measured counts so.
_LEAST_IOU: Final = 0.01
_MOST_TOLERANCES: Final = 10.0
#: So much more mean closeness is no chance.
_CLEARLY: Final = 0.1
#: What the other residuals count beside an IoU: they order what does not overlap yet.
_HINT: Final = 0.06


def closeness(results: Iterable[Result]) -> float:
    """How well one entity fits the photo, above 0 and at most 1, by its residuals in the picture.

    IoU * exp(-depth residual in tolerances): how much of it is where it should be in the picture,
    and how far off along the view. Without an IoU the mean of the other residuals stands for it.
    """
    iou, depth, others = None, 0.0, []
    for result in results:
        if isinstance(result.requirement, kinds.Overlap):
            iou = max(1.0 - _value(result), _LEAST_IOU)
        elif isinstance(result.requirement, kinds.Depth):
            depth = _in_tolerances(result)
        else:
            others.append(_in_tolerances(result))
    mean = sum(others) / len(others) if others else 0.0
    return math.exp(-depth - mean) if iou is None else iou * math.exp(-depth - _HINT * mean)


def mean_closeness(results: Iterable[Result]) -> float:
    """Of every entity that something of the picture is required of; 0 without any."""
    values = [
        closeness(r for r, _ in some) for some in _by_entity((r, r) for r in results).values()
    ]
    return sum(values) / len(values) if values else 0.0


def clearly_closest(scenes: Sequence[Sequence[Result]]) -> int:
    """The position of the last scene, or of the closest, where it is clearly closer than the last.

    scenes: results of the same requirements. An agent's last scene is often its best, and the mean
    closeness orders only scenes that are far apart.
    """
    means = [mean_closeness(results) for results in scenes]
    best = max(range(len(means)), key=lambda position: (means[position], position))
    return best if means[best] >= means[-1] + _CLEARLY else len(means) - 1


def acceptance_rule(
    requirement: Requirement,
) -> Literal["passes", "improves", "not_worse", "together"]:
    """How a requirement is accepted: as it says, else by its kind."""
    if requirement.accept is not None:
        return requirement.accept
    return "together" if isinstance(requirement, _RELATIVE) else "passes"


def blocks(result: Result) -> bool:
    """Whether a result blocks whatever was before: it has to pass, or nothing is known of it."""
    requirement = result.requirement
    if not requirement.hard or result.verdict == "pass":
        return False
    return acceptance_rule(requirement) == "passes" or result.verdict == "unknown"


def list_worse(
    before: Sequence[Result], after: Sequence[Result], n_declared: int
) -> tuple[Worse, ...]:
    """What an edit made worse and its rule does not allow, in the order of the requirements.

    before, after: of the same requirements, the first `n_declared` the edit's own; the rest are
    those of earlier edits, which it must not break.
    """
    pairs = list(zip(before, after, strict=True))
    own, others = pairs[:n_declared], pairs[n_declared:]
    worse = [*_own_rule_violations(own), *_together(own, others), *_regressions(others)]
    order = {id(b): k for k, (b, _) in enumerate(pairs)}
    return tuple(
        Worse(requirement=a.requirement, before=b.residual, after=a.residual)
        for b, a in sorted(worse, key=lambda pair: order[id(pair[0])])
    )


Pair = tuple[Result, Result]


def _is_judged(result: Result) -> bool:
    return result.requirement.hard and acceptance_rule(result.requirement) == "together"


def _by_entity(pairs: Iterable[Pair]) -> dict[object, list[Pair]]:
    """Those that are judged together; what is about no entity is one by itself."""
    found: dict[object, list[Pair]] = {}
    for b, a in pairs:
        if _is_judged(a):
            found.setdefault(getattr(a.requirement, "entity", a.requirement), []).append((b, a))
    return found


def _own_rule_violations(pairs: Iterable[Pair]) -> Iterator[Pair]:
    """Those that say themselves what they want."""
    for b, a in pairs:
        rule = acceptance_rule(a.requirement)
        rise = _rise(b, a)
        if a.requirement.hard and (
            (rule == "not_worse" and rise > 0) or (rule == "improves" and rise >= 0)
        ):
            yield b, a


def _together(own: Sequence[Pair], others: Iterable[Pair]) -> Iterator[Pair]:
    """Those that rose, where the entities are less close than they were.

    Others were not edited: how much is seen of them counts, not what moved the fit of all depths.
    """
    seen = [(b, b if isinstance(b.requirement, kinds.Depth) else a) for b, a in others]
    allowed = _SAME if _by_entity(own) else _HIDDEN
    if _gain(own) + _OTHERS * _gain(seen) < -allowed:
        yield from (pair for pair in (*own, *seen) if _is_judged(pair[1]) and _rise(*pair) > 0)


def _gain(pairs: Sequence[Pair]) -> float:
    """How much closer the entities are, all together."""
    return sum(
        closeness(a for _, a in some) - closeness(b for b, _ in some)
        for some in _by_entity(pairs).values()
    )


def _regressions(pairs: Iterable[Pair]) -> Iterator[Pair]:
    """Of earlier edits: what passed and does not."""
    for b, a in pairs:
        held = a.requirement.hard and acceptance_rule(a.requirement) != "together"
        if held and b.verdict == "pass" != a.verdict:
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


def _in_tolerances(result: Result) -> float:
    """A residual in tolerances; a tenth stands for a tolerance of 0."""
    return min(_value(result) / (result.tolerance or 0.1), _MOST_TOLERANCES)
