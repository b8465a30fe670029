"""Every relation: its margin in the facts of a pair, its unit, and when it may be asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

from legoworld.readouts.relation_contacts import INSIDE, TOUCH_M
from legoworld.records.relations import FactObject, FactPairs, Facts
from legoworld.records.track import Designator, Which

#: How deep two things reach into each other from which they collide, as the plugin has it.
COLLIDES_M: Final = 0.005
#: The share of a silhouette from which it counts as hidden.
HIDES: Final = 0.02
FACING_DEG: Final = 45.0


@dataclass(frozen=True)
class Pair:
    """The facts of (a, b): row k of the columns, swapped where that is of (b, a)."""

    pairs: FactPairs
    k: int
    is_swapped: bool

    def signed_fact(self, column: str) -> float:
        """A column that is below 0 where the relation holds of (b, a)."""
        value: float = getattr(self.pairs, column)[self.k]
        return (-value if self.is_swapped else value) + 0.0  # no -0.0

    def towards(self, name: str, unit: str = "") -> float | None:
        """A fact of a towards b, such as the angle of "angle_ab_deg"."""
        column = f"{name}_{'ba' if self.is_swapped else 'ab'}{unit}"
        value: float | None = getattr(self.pairs, column)[self.k]
        return value

    @property
    def inverse(self) -> Pair:
        """The same of (b, a)."""
        return Pair(self.pairs, self.k, not self.is_swapped)

    @property
    def surface_m(self) -> float | None:
        """Between their surfaces, where that is measured."""
        return self.pairs.surface_m[self.k]

    @property
    def distance_m(self) -> float:
        """Between their surfaces; where only their boxes are known, at least as far."""
        return self.pairs.apart_m[self.k] if self.surface_m is None else self.surface_m


@dataclass(frozen=True, kw_only=True)
class Relation:
    """A relation of (a, b), which holds where its margin is above 0; None is unknown.

    yes, no: how far the margin must be on either side of 0 before it is asked, in `unit`. phrase:
    as in "is the cup ... the plate".
    """

    margin: Callable[[Pair], float | None]
    unit: str
    yes: float
    no: float
    phrase: str


def _over(value: float | None, least: float) -> float | None:
    return None if value is None else value - least


def _on(pair: Pair) -> float | None:
    """None where the two touch and neither rests on the other in balance: a rider on a horse."""
    gap, other = pair.towards("gap", "_m"), pair.inverse.towards("gap", "_m")
    if gap is not None:
        return TOUCH_M - abs(gap)
    apart = TOUCH_M - pair.distance_m
    return apart if apart < 0 else None if other is None else 0.0


def _inside(pair: Pair) -> float | None:
    """None where a convex hull holds a thing and the volume does not: in a bowl, or on a couch."""
    hull, within = pair.towards("inside"), pair.towards("within")
    if hull is None or hull < INSIDE:
        return _over(hull, INSIDE)
    return min(hull, within) - INSIDE if within is not None and within >= INSIDE else None


def _colliding(pair: Pair) -> float:
    depth = pair.pairs.depth_m[pair.k]
    return (-pair.distance_m if depth is None else depth) - COLLIDES_M


def _near(pair: Pair) -> float:
    near_m = pair.pairs.near_m[pair.k]
    return 1 - pair.distance_m / near_m if near_m else 0.0


def _facing(pair: Pair) -> float | None:
    angle = pair.towards("angle", "_deg")
    return None if angle is None else FACING_DEG - angle


def _relations() -> Iterator[tuple[str, Relation]]:
    """Every relation by name, and the inverse where it has a word."""
    degrees, metres, share, size = "degrees", "m", "share", "of near_m"
    for name, phrase, inverse, phrase_of_inverse, unit, yes, no, margin in (
        ("left_of", "to the left of", "right_of", "to the right of",
         metres, 0.05, 0.05, lambda p: p.signed_fact("left_m")),
        ("above", "higher up in the picture than", "below", "lower down in the picture than",
         metres, 0.05, 0.05, lambda p: p.signed_fact("above_m")),
        ("in_front_of", "in front of", "behind", "behind",
         metres, 0.05, 0.05, lambda p: p.signed_fact("front_m")),
        ("on", "resting on", "supports", "supporting", metres, 0.005, 0.04, _on),
        ("inside", "inside", "contains", "around",
         share, 0.04, 0.45, _inside),
        ("under", "straight below", "over", "straight above",
         metres, 0.06, 0.06, lambda p: p.towards("under", "_m")),
        ("touching", "touching", "", "", metres, 0.005, 0.04, lambda p: TOUCH_M - p.distance_m),
        ("colliding", "reaching into", "", "", metres, 0.005, 0.005, _colliding),
        ("near", "close to", "", "", size, 0.5, 1.0, _near),
        ("far_from", "far from", "", "", size, 1.0, 0.5, lambda p: -_near(p)),
        ("facing", "facing", "", "", degrees, 15.0, 45.0, _facing),
        ("facing_away", "facing away from", "", "", degrees, 15.0, 45.0,
         lambda p: _over(p.towards("angle", "_deg"), 180 - FACING_DEG)),
        ("hidden_by", "partly hidden by", "hides", "partly hiding",
         share, 0.08, 0.02, lambda p: _over(p.towards("hidden"), HIDES)),
    ):  # fmt: skip
        relation = Relation(margin=margin, unit=unit, yes=yes, no=no, phrase=phrase)
        yield name, relation
        if inverse:
            reverse = _reverse_margin(margin)
            yield inverse, replace(relation, margin=reverse, phrase=phrase_of_inverse)


def _reverse_margin(margin: Callable[[Pair], float | None]) -> Callable[[Pair], float | None]:
    return lambda pair: margin(pair.inverse)


RELATIONS: Final[Mapping[str, Relation]] = dict(_relations())

#: Superlatives that name one of several: the relation it has to all others of its category.
WHICH: Final[Mapping[Which, str]] = {
    "leftmost": "left_of",
    "rightmost": "right_of",
    "closest": "in_front_of",
    "farthest": "behind",
}


@dataclass(frozen=True)
class FactBase:
    """The facts of one picture. Objects are named by their ids."""

    facts: Facts

    @cached_property
    def objects(self) -> dict[int, FactObject]:
        """Objects by id."""
        return {thing.id: thing for thing in self.facts.objects}

    @cached_property
    def _row(self) -> dict[tuple[int, int], int]:
        pairs = self.facts.pairs
        return {pair: k for k, pair in enumerate(zip(pairs.a, pairs.b, strict=True))}

    def pair(self, a: int, b: int) -> Pair:
        """The facts of (a, b). KeyError for one that is not there, or for one with itself."""
        return Pair(self.facts.pairs, self._row[min(a, b), max(a, b)], a > b)

    def margin(self, relation: str, a: int, b: int) -> float | None:
        """How far (a, b) is from where the relation begins to hold, in its unit; None: unknown."""
        return RELATIONS[relation].margin(self.pair(a, b))

    def clear_answer(self, relation: str, a: int, b: int) -> bool | None:
        """Whether the relation holds, where the margin is beyond the slack; None elsewhere."""
        margin, kind = self.margin(relation, a, b), RELATIONS[relation]
        if margin is None:
            return None
        return True if margin >= kind.yes else False if margin <= -kind.no else None

    def of_category(self, category: str) -> list[FactObject]:
        """The objects of a category, by id."""
        return [thing for thing in self.facts.objects if thing.category == category]

    def designated_objects(self, name: Designator, *, clearly: bool = False) -> list[FactObject]:
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
        for (a, b), swaps in ((pair, swaps) for pair in self._row for swaps in (False, True)):
            first, second = (b, a) if swaps else (a, b)
            for name, relation in RELATIONS.items():
                margin = self.margin(name, first, second)
                yield {
                    "a": first,
                    "relation": name,
                    "b": second,
                    "holds": None if margin is None else margin > 0,
                    "margin": margin,
                    "unit": relation.unit,
                    "asked": self.clear_answer(name, first, second) is not None,
                }


def describe(name: Designator) -> str:
    """A designator in words, such as "the leftmost cup"."""
    return " ".join(filter(None, ("the", name.which, name.category)))


def options_text(options: Sequence[Designator]) -> str:
    """Options in words: "the cup, the plate or the knife"."""
    *first, last = map(describe, options)
    return f"{', '.join(first)} or {last}"
