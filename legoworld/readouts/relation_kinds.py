"""Every relation: its margin in the facts of a pair, its unit, and when it may be asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from legoworld.readouts.relation_facts import TOUCH_M
from legoworld.records.relations import Designator, FactObject, FactPairs, Facts, Which

#: The share of a thing in another's convex hull from which it is inside of it.
INSIDE: Final = 0.95
#: The share of a silhouette from which it counts as hidden.
HIDES: Final = 0.02
FACING_DEG: Final = 45.0


#: A margin of the pair in row k; turned: 1 where it is asked of (b, a), else 0.
Margin = Callable[[FactPairs, int, int], float | None]


@dataclass(frozen=True, kw_only=True)
class Relation:
    """A relation of (a, b), which holds where its margin is above 0; None is unknown.

    yes, no: how far the margin must be on either side of 0 before it is asked, in `unit`. phrase:
    as in "is the cup ... the plate".
    """

    margin: Margin
    unit: str
    yes: float
    no: float
    phrase: str


def _across(column: str, sign: int, phrase: str) -> Relation:
    def margin(pairs: FactPairs, k: int, turned: int) -> float:
        value: float = getattr(pairs, column)[k]
        return sign * (1 - 2 * turned) * value + 0.0

    return Relation(margin=margin, unit="m", yes=0.05, no=0.05, phrase=phrase)


def _distance(pairs: FactPairs, k: int) -> float:
    """Of the surfaces; where only their boxes are known, at least as far."""
    surface = pairs.surface_m[k]
    return pairs.apart_m[k] if surface is None else surface


def _on(pairs: FactPairs, k: int, turned: int) -> float:
    gap = (pairs.gap_ab_m, pairs.gap_ba_m)[turned][k]
    return min(0.0, TOUCH_M - _distance(pairs, k)) if gap is None else TOUCH_M - abs(gap)


def _near(pairs: FactPairs, k: int, _turned: int) -> float:
    return 1 - _distance(pairs, k) / pairs.near_m[k] if pairs.near_m[k] else 0.0


def _inside(pairs: FactPairs, k: int, turned: int) -> float | None:
    share = (pairs.inside_ab, pairs.inside_ba)[turned][k]
    return None if share is None else share - INSIDE


def _facing(pairs: FactPairs, k: int, turned: int) -> float | None:
    angle = (pairs.angle_ab_deg, pairs.angle_ba_deg)[turned][k]
    return None if angle is None else FACING_DEG - angle


def _facing_away(pairs: FactPairs, k: int, turned: int) -> float | None:
    margin = _facing(pairs, k, turned)
    return None if margin is None else 2 * FACING_DEG - 180 - margin


def _hides(pairs: FactPairs, k: int, turned: int) -> float:
    return (pairs.hidden_ba, pairs.hidden_ab)[turned][k] - HIDES


def _under(pairs: FactPairs, k: int, turned: int) -> float:
    return (pairs.under_ab_m, pairs.under_ba_m)[turned][k]


def _touching(pairs: FactPairs, k: int, _turned: int) -> float:
    return TOUCH_M - _distance(pairs, k)


def _of_turned(margin: Margin) -> Margin:
    return lambda pairs, k, turned: margin(pairs, k, 1 - turned)


def _relation(margin: Margin, unit: str, yes: float, no: float, phrase: str) -> Relation:
    return Relation(margin=margin, unit=unit, yes=yes, no=no, phrase=phrase)


RELATIONS: Final[Mapping[str, Relation]] = {
    "left_of": _across("left_m", 1, "to the left of"),
    "right_of": _across("left_m", -1, "to the right of"),
    "above": _across("above_m", 1, "higher up in the picture than"),
    "below": _across("above_m", -1, "lower down in the picture than"),
    "in_front_of": _across("front_m", 1, "in front of"),
    "behind": _across("front_m", -1, "behind"),
    "on": _relation(_on, "m", 0.005, 0.04, "resting on"),
    "supports": _relation(_of_turned(_on), "m", 0.005, 0.04, "supporting"),
    "inside": _relation(_inside, "share", 0.04, 0.45, "inside"),
    "contains": _relation(_of_turned(_inside), "share", 0.04, 0.45, "around"),
    "under": _relation(_under, "m", 0.06, 0.06, "straight below"),
    "over": _relation(_of_turned(_under), "m", 0.06, 0.06, "straight above"),
    "touching": _relation(_touching, "m", 0.005, 0.04, "touching"),
    "near": _relation(_near, "of near_m", 0.5, 1.0, "close to"),
    "far_from": _relation(
        lambda pairs, k, turned: -_near(pairs, k, turned), "of near_m", 1.0, 0.5, "far from"
    ),
    "facing": _relation(_facing, "degrees", 15.0, 45.0, "facing"),
    "facing_away": _relation(_facing_away, "degrees", 15.0, 45.0, "facing away from"),
    "hides": _relation(_hides, "share", 0.08, 0.02, "partly hiding"),
    "hidden_by": _relation(_of_turned(_hides), "share", 0.08, 0.02, "partly hidden by"),
}

#: Superlatives that name one of several: the relation it has to all others of its category.
WHICH: Final[Mapping[Which, str]] = {
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
    def _row(self) -> dict[tuple[int, int], int]:
        pairs = self.facts.pairs
        return {pair: k for k, pair in enumerate(zip(pairs.a, pairs.b, strict=True))}

    def pair(self, a: int, b: int) -> int:
        """The row of two objects. KeyError for one that is not there, or for one with itself."""
        return self._row[min(a, b), max(a, b)]

    def distance_m(self, a: int, b: int) -> float:
        """Between the surfaces of two objects; where they are not measured, at least that far."""
        return _distance(self.facts.pairs, self.pair(a, b))

    def is_measured(self, a: int, b: int) -> bool:
        """Whether the distance of two objects is that of their surfaces."""
        return self.facts.pairs.surface_m[self.pair(a, b)] is not None

    def margin(self, relation: str, a: int, b: int) -> float | None:
        """How far (a, b) is from where the relation begins to hold, in its unit; None: unknown."""
        return RELATIONS[relation].margin(self.facts.pairs, self.pair(a, b), int(a > b))

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
        for (a, b), turned in ((pair, turned) for pair in self._row for turned in (False, True)):
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
