"""Questions about a picture by template and seed, with their answers by its facts.

A question is asked only where the margin of its answer is beyond the relation's slack, of things
that can be named and are seen well enough.
"""

from __future__ import annotations

import hashlib
import itertools
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from msgspec.structs import replace

from legoworld.evaluation.relations.answering import answer_by_facts
from legoworld.readouts.relation_kinds import RELATIONS, WHICH, FactBase, describe, options_text
from legoworld.records.relations import FactObject, Facts, TrueAnswer
from legoworld.records.track import Designator, Kind, Question

#: As the card declares them.
MIN_AREA_PX: Final = 100
MIN_VISIBLE: Final = 0.25
PER_RELATION: Final = 4
OPTIONS: Final = 3
SEED: Final = 0
#: Numbers are asked of things that are seen whole.
_WHOLE: Final = 0.9
#: How much farther the second nearest is, and at least in metres.
_FARTHER: Final = 1.5
_FARTHER_M: Final = 0.05
#: Relations that are asked. Not `facing`: most things have no front that people agree on; nor
#: `inside`: a pillow on a couch lies in its convex hull.
ASKED: Final = (
    "left_of", "right_of", "above", "below", "in_front_of", "behind", "on", "touching", "near",
    "hides",
)  # fmt: skip
_AXES: Final = (("left_of", "right_of"), ("in_front_of", "behind"))
_CONTACTS: Final = ("on", "touching")
#: The margin of `inside` from which half of a thing is held.
_HELD: Final = -0.45
#: From which share of the picture's longer side a gap between boxes is seen.
_SEEN_GAP: Final = 0.02
#: Relations that single out one of several things.
_SINGLE_OUT: Final = ("left_of", "right_of", "on")


def make_questions(
    facts: Facts, scene: str, image_id: int, categories: Sequence[str]
) -> list[TrueAnswer]:
    """The questions of one picture. categories: of the vocabulary, for what is not there."""
    asker = _Asker(base=FactBase(facts), scene=scene, image_id=image_id)
    made = [one for name in ASKED for one in asker.balance(name, asker.relation(name))]
    made += asker.balance("exists", asker.exists(categories))
    made += asker.draw("count", asker.counts(), PER_RELATION)
    made += asker.draw("nearest_to", asker.nearest(), PER_RELATION // 2)
    made += asker.draw("closest_to_camera", asker.closest(), PER_RELATION // 2)
    made += asker.draw("distance", asker.distances(), PER_RELATION // 2)
    made += asker.draw("height", asker.heights(), PER_RELATION // 2)
    made += asker.draw("refer", asker.expressions(), PER_RELATION)
    return [
        replace(one, question=replace(one.question, id=f"{scene}-{n:03}"))
        for n, one in enumerate(made, start=1)
    ]


@dataclass(frozen=True, kw_only=True)
class _Asker:
    """The questions of one picture, template by template."""

    base: FactBase
    scene: str
    image_id: int

    @cached_property
    def names(self) -> dict[int, Designator]:
        """How each thing that may be asked about is named, by id."""
        names: dict[int, Designator] = {}
        for thing in filter(_is_seen, self.base.facts.objects):
            for name in _names_in(thing.category):
                if self.base.designated_objects(name, clearly=True) == [thing]:
                    names.setdefault(thing.id, name)
        return names

    def draw(self, template: str, made: Iterable[TrueAnswer], most: int) -> list[TrueAnswer]:
        """At most so many of a template's questions."""
        drawn = list(made)
        self._random(template).shuffle(drawn)
        return drawn[:most]

    def balance(self, template: str, made: Iterable[TrueAnswer]) -> list[TrueAnswer]:
        """As many that are true as that are false."""
        every = self.draw(template, made, len(self.names) ** 2 + 1000)
        true, false = ([one for one in every if one.answer is value] for value in (True, False))
        most = min(len(true), len(false), PER_RELATION // 2)
        return self.draw(template, true[:most] + false[:most], PER_RELATION)

    def _random(self, template: str) -> random.Random:
        digest = hashlib.sha256(f"{SEED}/{self.scene}/{template}".encode()).digest()
        return random.Random(int.from_bytes(digest[:8], "big"))

    def _ask(
        self,
        kind: Kind,
        relation: str,
        text: str,
        a: Designator,
        b: Designator | None = None,
        *,
        options: tuple[Designator, ...] = (),
        chance: float | None = None,
        things: Iterable[int] = (),
    ) -> TrueAnswer:
        """A question with what the facts answer. things: ids of what is drawn."""
        question = Question(
            id="", image_id=self.image_id, kind=kind, relation=relation, text=text,
            a=a, b=b, options=options,
        )  # fmt: skip
        return TrueAnswer(
            question=question,
            answer=answer_by_facts(question, self.base).value,
            chance=chance,
            boxes=tuple(self.base.objects[i].bbox_xywh_px for i in things),
        )

    def relation(self, relation: str) -> Iterator[TrueAnswer]:
        """Whether a relation holds between two things."""
        phrase = RELATIONS[relation].phrase
        named = {i: name for i, name in self.names.items() if not _gives_away(relation, name)}
        for a, b in itertools.permutations(named, 2):
            holds = self.base.clear_answer(relation, a, b)
            if holds is not None and _reads_well(self.base, relation, a, b, holds=holds):
                text = f"Is {describe(named[a])} {phrase} {describe(named[b])}?"
                yield self._ask(
                    "yes_no", relation, text, named[a], named[b], chance=0.5, things=(a, b)
                )

    def exists(self, categories: Sequence[str]) -> Iterator[TrueAnswer]:
        """Whether the picture has a thing of a category; what it lacks is out of the vocabulary."""
        there = {thing.category: thing.id for thing in filter(_is_seen, self.base.facts.objects)}
        lacking = {*categories} - {thing.category for thing in self.base.facts.objects}
        for category in [*there, *sorted(lacking)]:
            article = "an" if category[0] in "aeiou" else "a"
            yield self._ask(
                "yes_no",
                "exists",
                f"Is there {article} {category} in the picture?",
                Designator(category=category),
                chance=0.5,
                things=[there[category]] if category in there else (),
            )

    def counts(self) -> Iterator[TrueAnswer]:
        """How many there are of a category all of whose things are seen."""
        for category in dict.fromkeys(thing.category for thing in self.base.facts.objects):
            things = self.base.of_category(category)
            if all(map(_is_seen, things)):
                text = f"How many objects of the category {category!r} are in the picture?"
                name, ids = Designator(category=category), [thing.id for thing in things]
                yield self._ask("count", "count", text, name, things=ids)

    def nearest(self) -> Iterator[TrueAnswer]:
        """Which of several things is nearest to another."""
        for a, name in self.names.items():
            others = sorted((self.base.pair(a, b).distance_m, b) for b in self.names if b != a)
            if len(others) < OPTIONS or self.base.pair(a, others[0][1]).surface_m is None:
                continue
            least, best = others[0]
            if others[1][0] >= least * _FARTHER + _FARTHER_M:
                text = f"Which is nearest to {describe(name)}"
                farther = [b for _, b in others[1:]]
                yield self._choice("nearest_to", text, best, farther, anchor=a)

    def closest(self) -> Iterator[TrueAnswer]:
        """Which of several things is closest to the camera."""
        names = [a for a, name in self.names.items() if not _gives_away("in_front_of", name)]
        for a in names:
            behind = [b for b in names if b != a and self.base.clear_answer("in_front_of", a, b)]
            if len(behind) >= OPTIONS - 1:
                text = "Which is closest to the camera"
                yield self._choice("closest_to_camera", text, a, behind)

    def _choice(
        self, relation: str, text: str, best: int, others: Sequence[int], anchor: int | None = None
    ) -> TrueAnswer:
        random = self._random(f"{relation}/{best}/{anchor}")
        chosen = [best, *random.sample(others, OPTIONS - 1)]
        random.shuffle(chosen)
        options = tuple(self.names[i] for i in chosen)
        return self._ask(
            "choice",
            relation,
            f"{text}: {options_text(options)}?",
            options[0] if anchor is None else self.names[anchor],  # never the answer itself
            options=options,
            chance=1 / OPTIONS,
            things=(best,) if anchor is None else (anchor, best),
        )

    def distances(self) -> Iterator[TrueAnswer]:
        """How far apart the middles of two things are."""
        for a, b in itertools.combinations(filter(self._is_whole, self.names), 2):
            one, two = self.names[a], self.names[b]
            both = f"{describe(one)} and {describe(two)}"
            text = f"How many metres are there between the middles of {both}?"
            made = self._ask("number", "distance", text, one, two, things=(a, b))
            if made.answer:
                yield made

    def heights(self) -> Iterator[TrueAnswer]:
        """How high a thing is."""
        for a in filter(self._is_whole, self.names):
            text = f"How tall is {describe(self.names[a])}, in metres?"
            made = self._ask("number", "height", text, self.names[a], things=(a,))
            if made.answer:
                yield made

    def expressions(self) -> Iterator[TrueAnswer]:
        """The box of a thing that an expression singles out among several of its category."""
        for thing in filter(_is_seen, self.base.facts.objects):
            plain, *several = _names_in(thing.category)
            n = len(self.base.designated_objects(plain))
            found: list[tuple[str, Designator, int | None]] = [
                (name.which, name, None)
                for name in several
                if n > 1 and self.base.designated_objects(name, clearly=True) == [thing]
            ]
            found += [
                (relation, plain, b)
                for relation, b in itertools.product(_SINGLE_OUT, self.names)
                if n > 1 and self._singles_out(relation, thing, b)
            ]
            for relation, name, b in found:
                other = None if b is None else self.names[b]
                of = "" if other is None else f" {RELATIONS[relation].phrase} {describe(other)}"
                text = f"Give the box of {describe(name)}{of}."
                yield self._ask(
                    "refer", relation, text, name, other, chance=1 / n, things=(thing.id,)
                )

    def _singles_out(self, relation: str, thing: FactObject, b: int) -> bool:
        """Whether it holds of this thing and clearly of no other of its category."""
        things = self.base.of_category(thing.category)
        return b not in {other.id for other in things} and all(
            self.base.clear_answer(relation, other.id, b) is (other is thing) for other in things
        )

    def _is_whole(self, a: int) -> bool:
        """Whether a thing is seen almost whole, and ends inside of the picture."""
        thing, (width, height) = self.base.objects[a], self.base.facts.size_wh
        x, y, w, h = thing.bbox_xywh_px
        inside = x > 0 and y > 0 and x + w < width and y + h < height
        return inside and thing.visible >= _WHOLE


def _names_in(category: str) -> list[Designator]:
    """The plain name of a category, and its superlatives."""
    return [Designator(category=category, which=which) for which in ("", *WHICH)]


def _is_seen(thing: FactObject) -> bool:
    return thing.area_px >= MIN_AREA_PX and thing.visible >= MIN_VISIBLE


def _gives_away(relation: str, name: Designator) -> bool:
    """Whether a name alone tells something of the answer: the closest is rarely behind."""
    return any(relation in axis and WHICH.get(name.which) in axis for axis in _AXES)


def _reads_well(base: FactBase, relation: str, a: int, b: int, *, holds: bool) -> bool:
    """Whether people would say so of the two.

    What a bowl holds rests on it and is in it: neither is asked. What does not touch is apart in
    the picture, too: a gap that nobody sees is none.
    """
    if not holds and relation in _CONTACTS:
        x, y, w, h = base.objects[a].bbox_xywh_px
        u, v, p, q = base.objects[b].bbox_xywh_px
        return max(u - x - w, x - u - p, v - y - h, y - v - q) >= _SEEN_GAP * max(
            base.facts.size_wh
        )
    return relation != "on" or (base.margin("inside", a, b) or 0.0) <= _HELD
