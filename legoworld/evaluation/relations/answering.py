"""What the facts of a scene answer to a question, and what a given answer means."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple

from legoworld.files import Json
from legoworld.readouts.relation_kinds import RELATIONS, FactBase, describe
from legoworld.records.relations import FactObject
from legoworld.records.track import Answered, Question

#: Relations whose meaning depends on whose left, or front, it is.
_OF_A_FRAME: Final = frozenset({"left_of", "right_of", "above", "below", "in_front_of", "behind"})
_YES: Final = {"yes": True, "true": True, "no": False, "false": False}
_LENGTH: Final = re.compile(r"([-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?)\s*(?:m|metres?|meters?)?")
_UNKNOWN: Final = frozenset({"", "unknown", "none", "null", "n/a"})


class Reply(NamedTuple):
    """An answer, or None and why there is none."""

    value: Answered | None
    why: str = ""


class _NoAnswerError(Exception):
    """A question cannot be answered; the text is the reason."""


def answer_by_facts(question: Question, base: FactBase) -> Reply:
    """The answer of a scene; a reason where what the question names is not there."""
    if question.frame and question.relation in _OF_A_FRAME:
        return Reply(None, "foreign_frame")
    answer = _ANSWERS.get(question.relation, _BY_KIND.get(question.kind))
    if answer is None:
        return Reply(None, "not_a_relation")
    try:
        return Reply(answer(question, base))
    except _NoAnswerError as error:
        return Reply(None, str(error))


def read_answer(question: Question, given: Json) -> Reply:
    """A given answer as the question's kind has it; a reason where it cannot be read so."""
    if given is None or (isinstance(given, str) and given.strip().casefold() in _UNKNOWN):
        return Reply(None, "no_answer")
    value = _READERS[question.kind](question, given)
    return Reply(None, "unreadable") if value is None else Reply(value)


def _one(base: FactBase, question: Question, name: str) -> FactObject:
    """The one thing that the question names as a or b."""
    designator = getattr(question, name)
    found = base.designated_objects(designator)
    if not found:
        raise _NoAnswerError("not_there")
    if len(found) > 1:
        raise _NoAnswerError("ambiguous")
    return found[0]


def _two(base: FactBase, question: Question) -> tuple[int, int]:
    """The two things that the question names."""
    a, b = _one(base, question, "a"), _one(base, question, "b")
    if a.id == b.id:
        raise _NoAnswerError("ambiguous")
    return a.id, b.id


def _any_holds(base: FactBase, relation: str, pairs: Iterable[tuple[int, int]]) -> bool:
    """Whether a relation holds of any pair, where that is known."""
    if relation not in RELATIONS:
        raise _NoAnswerError("not_a_relation")
    margins = [base.margin(relation, a, b) for a, b in pairs if a != b]
    if any(margin is not None and margin > 0 for margin in margins):
        return True
    if None in margins:
        raise _NoAnswerError("no_front" if "facing" in relation else "undecided")
    return False


def _holds(question: Question, base: FactBase) -> bool:
    if question.b is None:
        raise _NoAnswerError("not_a_relation")
    if question.any:
        if question.a == question.b:
            raise _NoAnswerError("named_twice")
        of_both = base.designated_objects(question.a), base.designated_objects(question.b)
        if not all(of_both):
            raise _NoAnswerError("not_there")
        pairs = [(a.id, b.id) for a, b in itertools.product(*of_both)]
    else:
        pairs = [_two(base, question)]
    return _any_holds(base, question.relation, pairs)


def _nearest(question: Question, base: FactBase) -> str:
    anchor = _one(base, question, "a")
    return _least(
        question, base, lambda b: math.inf if b == anchor.id else base.pair(anchor.id, b).distance_m
    )


def _closest(question: Question, base: FactBase) -> str:
    return _least(question, base, lambda b: base.objects[b].centre_cam_m[2])


def _least(question: Question, base: FactBase, of: Callable[[int], float]) -> str:
    """The option with the least value, among those that name one thing."""
    found = [(name, base.designated_objects(name)) for name in question.options]
    values = [(of(things[0].id), describe(name)) for name, things in found if len(things) == 1]
    if not values:
        raise _NoAnswerError("not_there")
    return min(values)[1]


def _distance(question: Question, base: FactBase) -> float:
    return base.facts.pairs.centre_m[base.pair(*_two(base, question)).k]


def _refer(question: Question, base: FactBase) -> Answered:
    if question.b is None:
        return _one(base, question, "a").bbox_xywh_px
    anchor, things = _one(base, question, "b"), base.designated_objects(question.a)
    found = [t for t in things if _any_holds(base, question.relation, [(t.id, anchor.id)])]
    if len(found) != 1:
        raise _NoAnswerError("ambiguous" if found else "not_there")
    return found[0].bbox_xywh_px


_ANSWERS: Final[Mapping[str, Callable[[Question, FactBase], Answered]]] = {
    "exists": lambda question, base: bool(base.designated_objects(question.a)),
    "count": lambda question, base: len(base.designated_objects(question.a)),
    "nearest_to": _nearest,
    "closest_to_camera": _closest,
    "distance": _distance,
    "height": lambda question, base: _one(base, question, "a").size_m[2],
}
_BY_KIND: Final[Mapping[str, Callable[[Question, FactBase], Answered]]] = {
    "yes_no": _holds,
    "refer": _refer,
}


def _read_yes_no(_question: Question, given: Json) -> bool | None:
    if isinstance(given, bool):
        return given
    words = re.findall(r"[a-z]+", given.casefold()) if isinstance(given, str) else []
    return _YES.get(words[0]) if words else None


def _read_choice(question: Question, given: Json) -> str | None:
    if not isinstance(given, str):
        return None
    text = " ".join(given.casefold().strip(" .!").split()).removeprefix("the ")
    options = {describe(o).casefold().removeprefix("the "): describe(o) for o in question.options}
    return options.get(text)


def _read_number(_question: Question, given: Json) -> float | None:
    if isinstance(given, str):
        found = _LENGTH.fullmatch(given.casefold().strip())
        return float(found[1]) if found else None
    if isinstance(given, bool) or not isinstance(given, int | float):
        return None
    return float(given) if math.isfinite(given) else None


def _read_count(question: Question, given: Json) -> int | None:
    value = _read_number(question, given)
    return int(value) if value is not None and value == int(value) else None


def _read_box(question: Question, given: Json) -> Answered | None:
    numbers = [_read_number(question, v) for v in given] if isinstance(given, list | tuple) else []
    x, y, w, h = numbers if len(numbers) == 4 else [None] * 4
    if x is None or y is None or w is None or h is None or min(w, h) < 0:
        return None
    return (x, y, w, h)


_READERS: Final[Mapping[str, Callable[[Question, Json], Answered | None]]] = {
    "yes_no": _read_yes_no,
    "choice": _read_choice,
    "count": _read_count,
    "number": _read_number,
    "refer": _read_box,
}
