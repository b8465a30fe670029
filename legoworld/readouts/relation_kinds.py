"""Every relation: its margin in the facts of a pair, its unit, and when it may be asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from legoworld.readouts.relation_facts import TOUCH_M
from legoworld.records.relations import Designator, FactObject, FactPair, Facts

#: The share of a thing in another's convex hull from which it is inside of it.
INSIDE: Final = 0.95
#: The share of a silhouette from which it counts as hidden.
HIDES: Final = 0.02
FACING_DEG: Final = 45.0


@dataclass(frozen=True, kw_only=True)
class Relation:
    """A relation of (a, b). margin: of a pair, and whether (a, b) is turned around there.

    It holds where the margin is above 0; None is unknown. yes, no: how far the margin must be on
    either side of 0 before it is asked, in `unit`. phrase: as in "is the cup ... the plate".
    """

    margin: Callable[[FactPair, int], float | None]
    unit: str
    yes: float
    no: float
    phrase: str


def _signed(name: str, sign: int) -> Callable[[FactPair, int], float]:
    return lambda pair, turned: sign * (1 - 2 * turned) * getattr(pair, name) + 0.0


def _distance(pair: FactPair) -> float:
    """Of the surfaces; where only their boxes are known, at least as far."""
    return pair.apart_m if pair.surface_m is None else pair.surface_m


def _on(pair: FactPair, turned: int) -> float:
    gap = pair.gap_m[turned]
    if gap is not None:
        return TOUCH_M - abs(gap)
    return min(0.0, TOUCH_M - _distance(pair))


def _near(pair: FactPair, _turned: int) -> float:
    return 1 - _distance(pair) / pair.near_m if pair.near_m else 0.0


def _beyond(values: tuple[float | None, ...], at: int, least: float) -> float | None:
    value = values[at]
    return None if value is None else value - least


def _turned(
    margin: Callable[[FactPair, int], float | None],
) -> Callable[[FactPair, int], float | None]:
    return lambda pair, turned: margin(pair, 1 - turned)


def _inside(pair: FactPair, turned: int) -> float | None:
    return _beyond(pair.inside, turned, INSIDE)


def _facing(pair: FactPair, turned: int) -> float | None:
    angle = pair.angle_deg[turned]
    return None if angle is None else FACING_DEG - angle


def _hides(pair: FactPair, turned: int) -> float | None:
    return _beyond(pair.hidden, 1 - turned, HIDES)


def _across(name: str, sign: int, phrase: str) -> Relation:
    return Relation(margin=_signed(name, sign), unit="m", yes=0.05, no=0.05, phrase=phrase)


RELATIONS: Final[Mapping[str, Relation]] = {
    "left_of": _across("left_m", 1, "to the left of"),
    "right_of": _across("left_m", -1, "to the right of"),
    "above": _across("above_m", 1, "higher up in the picture than"),
    "below": _across("above_m", -1, "lower down in the picture than"),
    "in_front_of": _across("front_m", 1, "in front of"),
    "behind": _across("front_m", -1, "behind"),
    "on": Relation(margin=_on, unit="m", yes=0.005, no=0.04, phrase="resting on"),
    "supports": Relation(margin=_turned(_on), unit="m", yes=0.005, no=0.04, phrase="supporting"),
    "inside": Relation(margin=_inside, unit="share", yes=0.04, no=0.45, phrase="inside"),
    "contains": Relation(
        margin=_turned(_inside), unit="share", yes=0.04, no=0.45, phrase="around"
    ),
    "under": Relation(
        margin=lambda pair, turned: pair.under_m[turned],
        unit="m", yes=0.06, no=0.06, phrase="straight below",
    ),
    "over": Relation(
        margin=lambda pair, turned: pair.under_m[1 - turned],
        unit="m", yes=0.06, no=0.06, phrase="straight above",
    ),
    "touching": Relation(
        margin=lambda pair, _turned: TOUCH_M - _distance(pair),
        unit="m", yes=0.005, no=0.04, phrase="touching",
    ),
    "near": Relation(margin=_near, unit="of near_m", yes=0.5, no=1.0, phrase="close to"),
    "far_from": Relation(
        margin=lambda pair, _turned: -_near(pair, 0),
        unit="of near_m", yes=1.0, no=0.5, phrase="far from",
    ),
    "facing": Relation(margin=_facing, unit="degrees", yes=15.0, no=45.0, phrase="facing"),
    "facing_away": Relation(
        margin=lambda pair, turned: _beyond(pair.angle_deg, turned, 180 - FACING_DEG),
        unit="degrees", yes=15.0, no=45.0, phrase="facing away from",
    ),
    "hides": Relation(margin=_hides, unit="share", yes=0.08, no=0.02, phrase="partly hiding"),
    "hidden_by": Relation(
        margin=_turned(_hides), unit="share", yes=0.08, no=0.02, phrase="partly hidden by"
    ),
}  # fmt: skip

#: Superlatives that name one of several: the relation it has to all others of its category.
WHICH: Final = {
    "leftmost": "left_of",
    "rightmost": "right_of",
    "closest": "in_front_of",
    "farthest": "behind",
}


@dataclass(frozen=True)
class FactBase:
    """The facts of one picture, to be asked. Objects are named by their ids."""

    facts: Facts

    @cached_property
    def objects(self) -> dict[int, FactObject]:
        """Objects by id."""
        return {thing.id: thing for thing in self.facts.objects}

    @cached_property
    def _pairs(self) -> dict[tuple[int, int], FactPair]:
        return {(pair.a, pair.b): pair for pair in self.facts.pairs}

    def pair(self, a: int, b: int) -> FactPair:
        """The facts of two objects. KeyError for one that is not there, or for one with itself."""
        return self._pairs[min(a, b), max(a, b)]

    def margin(self, relation: str, a: int, b: int) -> float | None:
        """How far (a, b) is from where the relation begins to hold, in its unit; None: unknown."""
        return RELATIONS[relation].margin(self.pair(a, b), int(a > b))

    def asked(self, relation: str, a: int, b: int) -> bool | None:
        """Whether the relation holds, where the margin is beyond the slack; None elsewhere."""
        margin, kind = self.margin(relation, a, b), RELATIONS[relation]
        if margin is None:
            return None
        return True if margin >= kind.yes else False if margin <= -kind.no else None

    def of_category(self, category: str) -> list[FactObject]:
        """The objects of a category, by id."""
        return [thing for thing in self.facts.objects if thing.category == category]

    def named(self, name: Designator, *, clearly: bool = False) -> list[FactObject]:
        """The objects that a designator names. clearly: a superlative's margins beyond the slack.

        One at most for a superlative; the only one of its category is each of them.
        """
        found = self.of_category(name.category)
        if not name.which or len(found) < 2:
            return found
        relation = WHICH[name.which]
        least = RELATIONS[relation].yes if clearly else 0.0
        return [
            thing
            for thing in found
            if all(
                (self.margin(relation, thing.id, other.id) or 0.0) > least
                for other in found
                if other is not thing
            )
        ]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Every relation of every ordered pair, as plain values."""
        for (a, b), turned in ((key, turned) for key in self._pairs for turned in (False, True)):
            first, second = (b, a) if turned else (a, b)
            for name, relation in RELATIONS.items():
                margin = self.margin(name, first, second)
                yield {
                    "a": first,
                    "relation": name,
                    "b": second,
                    "holds": None if margin is None else margin > 0,
                    "margin": margin,
                    "unit": relation.unit,
                    "asked": self.asked(name, first, second) is not None,
                }


def describe(name: Designator) -> str:
    """A designator in words, such as "the leftmost cup"."""
    return " ".join(filter(None, ("the", name.which, name.category)))


def options_text(options: Sequence[Designator]) -> str:
    """Options in words: "the cup, the plate or the knife"."""
    *first, last = map(describe, options)
    return f"{', '.join(first)} or {last}"
