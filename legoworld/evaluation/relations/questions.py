"""Questions about a picture by template and seed, with their answers by its facts.

A question is asked only where the margin of its answer is beyond the relation's slack, of things
that can be named and are seen well enough.
"""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from msgspec.structs import replace

from legoworld.readouts.relation_kinds import (
    RELATIONS,
    WHICH,
    FactBase,
    describe,
    options_text,
)
from legoworld.records.relations import (
    Box,
    Designator,
    FactObject,
    Facts,
    Kind,
    Question,
    TrueAnswer,
)

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
    made = [
        *(answer for relation in ASKED for answer in asker.relation(relation)),
        *asker.exists(categories),
        *asker.counts(),
        *asker.nearest(),
        *asker.closest(),
        *asker.distances(),
        *asker.heights(),
        *asker.expressions(),
    ]
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
        for thing in self.base.facts.objects:
            if not _is_seen(thing):
                continue
            plain = Designator(category=thing.category)
            several = [replace(plain, which=which) for which in WHICH]
            for name in [plain, *several]:
                if self.base.named(name, clearly=True) == [thing]:
                    names.setdefault(thing.id, name)
        return names

    def _random(self, template: str) -> random.Random:
        digest = hashlib.sha256(f"{SEED}/{self.scene}/{template}".encode()).digest()
        return random.Random(int.from_bytes(digest[:8], "big"))

    def _drawn(self, template: str, made: Sequence[TrueAnswer], most: int) -> list[TrueAnswer]:
        drawn = list(made)
        self._random(template).shuffle(drawn)
        return drawn[:most]

    def _balanced(self, template: str, made: Sequence[TrueAnswer]) -> list[TrueAnswer]:
        """As many that are true as that are false."""
        true, false = ([one for one in made if one.answer is value] for value in (True, False))
        most = min(len(true), len(false), PER_RELATION // 2)
        both = [
            *self._drawn(f"{template}/true", true, most),
            *self._drawn(f"{template}/false", false, most),
        ]
        return self._drawn(f"{template}/order", both, len(both))

    def _question(
        self,
        kind: Kind,
        relation: str,
        text: str,
        a: Designator,
        b: Designator | None = None,
        options: tuple[Designator, ...] = (),
    ) -> Question:
        return Question(
            id="", image_id=self.image_id, kind=kind, relation=relation, text=text,
            a=a, b=b, options=options,
        )  # fmt: skip

    def _boxes(self, *ids: int) -> tuple[Box, ...]:
        return tuple(self.base.objects[i].bbox_xywh_px for i in ids)

    def _pairs(self) -> Iterator[tuple[int, int]]:
        yield from ((a, b) for a in self.names for b in self.names if a != b)

    def relation(self, relation: str) -> list[TrueAnswer]:
        """Whether a relation holds between two things."""
        phrase, made = RELATIONS[relation].phrase, []
        for a, b in self._pairs():
            holds = self.base.asked(relation, a, b)
            one, two = self.names[a], self.names[b]
            if holds is None or _gives_away(relation, one) or _gives_away(relation, two):
                continue
            if not _reads_well(self.base, relation, a, b, holds=holds):
                continue
            text = f"Is {describe(one)} {phrase} {describe(two)}?"
            question = self._question("yes_no", relation, text, one, two)
            made.append(_true(question, holds, chance=0.5, boxes=self._boxes(a, b)))
        return self._balanced(relation, made)

    def exists(self, categories: Sequence[str]) -> list[TrueAnswer]:
        """Whether the picture has a thing of a category; what it lacks is out of the vocabulary."""
        there = {thing.category: thing.id for thing in self.base.facts.objects if _is_seen(thing)}
        lacking = sorted({*categories} - {thing.category for thing in self.base.facts.objects})
        made = []
        for category in [*there, *lacking]:
            article = "an" if category[0] in "aeiou" else "a"
            text = f"Is there {article} {category} in the picture?"
            question = self._question("yes_no", "exists", text, Designator(category=category))
            boxes = self._boxes(there[category]) if category in there else ()
            made.append(_true(question, category in there, chance=0.5, boxes=boxes))
        return self._balanced("exists", made)

    def counts(self) -> list[TrueAnswer]:
        """How many there are of a category all of whose things are seen."""
        made = []
        for category in dict.fromkeys(thing.category for thing in self.base.facts.objects):
            things = self.base.of_category(category)
            if all(map(_is_seen, things)):
                text = f"How many objects of the category {category!r} are in the picture?"
                question = self._question("count", "count", text, Designator(category=category))
                boxes = self._boxes(*(thing.id for thing in things))
                made.append(_true(question, len(things), boxes=boxes))
        return self._drawn("count", made, PER_RELATION)

    def nearest(self) -> list[TrueAnswer]:
        """Which of several things is nearest to another."""
        made = []
        for a, name in self.names.items():
            others = sorted((self._apart(a, b), b) for b in self.names if b != a)
            if len(others) < OPTIONS or self._surface(a, others[0][1]) is None:
                continue
            least, best = others[0]
            farther = [b for d, b in others[1:] if d >= least * _FARTHER + _FARTHER_M]
            if len(farther) == len(others) - 1:
                text = f"Which is nearest to {describe(name)}"
                made.append(self._choice("nearest_to", text, best, farther, name))
        return self._drawn("nearest_to", made, PER_RELATION // 2)

    def closest(self) -> list[TrueAnswer]:
        """Which of several things is closest to the camera."""
        made = []
        names = [a for a, name in self.names.items() if not _gives_away("in_front_of", name)]
        for a in names:
            behind = [b for b in names if b != a and self.base.asked("in_front_of", a, b)]
            if len(behind) >= OPTIONS - 1:
                made.append(
                    self._choice("closest_to_camera", "Which is closest to the camera", a, behind)
                )
        return self._drawn("closest_to_camera", made, PER_RELATION // 2)

    def _choice(
        self,
        relation: str,
        text: str,
        best: int,
        others: Sequence[int],
        a: Designator | None = None,
    ) -> TrueAnswer:
        name = self.names[best]
        chooser = self._random(f"{relation}/{describe(a or name)}")
        options = [name, *(self.names[b] for b in chooser.sample(others, OPTIONS - 1))]
        chooser.shuffle(options)
        text = f"{text}: {options_text(options)}?"
        about = a or options[0]  # never the answer itself
        question = self._question("choice", relation, text, about, options=tuple(options))
        anchor = [i for i, other in self.names.items() if other == a]
        answer, boxes = describe(name), self._boxes(*anchor, best)
        return _true(question, answer, chance=1 / len(options), boxes=boxes)

    def distances(self) -> list[TrueAnswer]:
        """How far apart the middles of two things are."""
        made = []
        for a, b in self._pairs():
            if a < b and self._is_whole(a) and self._is_whole(b):
                one, two = self.names[a], self.names[b]
                both = f"{describe(one)} and {describe(two)}"
                text = f"How many metres are there between the middles of {both}?"
                question = self._question("number", "distance", text, one, two)
                apart = self.base.facts.pairs.centre_m[self.base.pair(a, b)]
                if apart > 0:
                    made.append(_true(question, apart, boxes=self._boxes(a, b)))
        return self._drawn("distance", made, PER_RELATION // 2)

    def heights(self) -> list[TrueAnswer]:
        """How high a thing is."""
        made = []
        for a, name in self.names.items():
            height = self.base.objects[a].size_m[2]
            if self._is_whole(a) and height > 0:
                text = f"How tall is {describe(name)}, in metres?"
                question = self._question("number", "height", text, name)
                made.append(_true(question, height, boxes=self._boxes(a)))
        return self._drawn("height", made, PER_RELATION // 2)

    def expressions(self) -> list[TrueAnswer]:
        """The box of a thing that an expression singles out among several of its category."""
        made = []
        for thing in self.base.facts.objects:
            n = len(self.base.of_category(thing.category))
            if n < 2 or not _is_seen(thing):
                continue
            for which in WHICH:
                name = Designator(category=thing.category, which=which)
                if self.base.named(name, clearly=True) == [thing]:
                    text = f"Give the box of {describe(name)}."
                    question = self._question("refer", which, text, name)
                    made.append(self._box(question, thing, n))
            for relation, b in ((r, b) for r in _SINGLE_OUT for b in self.names):
                if self._singles_out(relation, thing, b):
                    one, two = Designator(category=thing.category), self.names[b]
                    phrase = RELATIONS[relation].phrase
                    text = f"Give the box of {describe(one)} {phrase} {describe(two)}."
                    question = self._question("refer", relation, text, one, two)
                    made.append(self._box(question, thing, n))
        return self._drawn("refer", made, PER_RELATION)

    def _box(self, question: Question, thing: FactObject, n: int) -> TrueAnswer:
        return _true(question, thing.bbox_xywh_px, chance=1 / n, boxes=self._boxes(thing.id))

    def _singles_out(self, relation: str, thing: FactObject, b: int) -> bool:
        """Whether it holds of this thing and clearly of no other of its category."""
        if self.base.objects[b].category == thing.category:
            return False
        asked = {
            other.id: self.base.asked(relation, other.id, b)
            for other in self.base.of_category(thing.category)
        }
        return asked.pop(thing.id) is True and all(value is False for value in asked.values())

    def _surface(self, a: int, b: int) -> float | None:
        return self.base.facts.pairs.surface_m[self.base.pair(a, b)]

    def _apart(self, a: int, b: int) -> float:
        surface = self._surface(a, b)
        return self.base.facts.pairs.apart_m[self.base.pair(a, b)] if surface is None else surface

    def _is_whole(self, a: int) -> bool:
        """Whether a thing is seen almost whole, and ends inside of the picture."""
        thing, (width, height) = self.base.objects[a], self.base.facts.size_wh
        x, y, w, h = thing.bbox_xywh_px
        inside = x > 0 and y > 0 and x + w < width and y + h < height
        return inside and (thing.visible or 0.0) >= _WHOLE


def _is_seen(thing: FactObject) -> bool:
    return thing.area_px >= MIN_AREA_PX and (thing.visible or 0.0) >= MIN_VISIBLE


def _gives_away(relation: str, name: Designator) -> bool:
    """Whether a name alone tells something of the answer: the closest is rarely behind."""
    return any(relation in axis and WHICH.get(name.which) in axis for axis in _AXES)


def _reads_well(base: FactBase, relation: str, a: int, b: int, *, holds: bool) -> bool:
    """Whether people would say so of the two.

    What a bowl holds rests on it and is in it: neither is asked. What does not touch is apart in
    the picture, too: a gap that nobody sees is none.
    """
    if not holds and relation in _CONTACTS:
        boxes = base.objects[a].bbox_xywh_px, base.objects[b].bbox_xywh_px
        gaps = [_box_gap(*boxes, axis) for axis in (0, 1)]
        return max(gaps) >= _SEEN_GAP * max(base.facts.size_wh)
    return relation != "on" or (base.margin("inside", a, b) or 0.0) <= _HELD


def _box_gap(one: Box, other: Box, axis: int) -> float:
    """The gap of two boxes along x or y, in pixels; negative where they overlap there."""
    return max(other[axis] - one[axis] - one[axis + 2], one[axis] - other[axis] - other[axis + 2])


def _true(
    question: Question,
    answer: bool | int | float | str | Box,
    *,
    chance: float | None = None,
    boxes: tuple[Box, ...] = (),
) -> TrueAnswer:
    return TrueAnswer(question=question, answer=answer, chance=chance, boxes=boxes)
