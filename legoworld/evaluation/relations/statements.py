"""Statements about photos that people labelled true or false, in the format of VSR.

Visual Spatial Reasoning (Liu, Emerson, Collier, TACL 2023): one JSON object a line, with `image`,
`caption`, `relation` and `label`.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Final

from legoworld.records.base import UNSET
from legoworld.records.relations import Statement, TrueAnswer
from legoworld.records.track import Designator, Question
from legoworld.tracks.track import scene_name
from legoworld.tracks.vocabulary import Vocabulary, normal_name

#: VSR's words by the relation they mean here. Others are asked and stay unknown.
WORDS: Final[Mapping[str, str]] = {
    word: relation
    for relation, words in {
        "left_of": "left of/at the left side of",
        "right_of": "right of/at the right side of",
        "above": "above",
        "below": "below",
        "over": "over",
        "under": "under/beneath",
        "in_front_of": "in front of/ahead of",
        "behind": "behind/at the back of",
        "on": "on/on top of",
        "inside": "in/inside/within/enclosed by",
        "contains": "contains",
        "touching": "touching",
        "near": "near/close to/by/next to/beside/alongside/adjacent to/at the side of",
        "far_from": "far from/far away from",
        "facing": "facing",
        "facing_away": "facing away from",
    }.items()
    for word in words.split("/")
}
_BEFORE: Final = re.compile(r"^(?:the|a|an)\s+|\s+(?:is|are)(?:\s+(?:to|on|at)\s+the)?$")


def statement_answers(
    statements: Iterable[Statement], vocabulary: Vocabulary
) -> dict[str, list[TrueAnswer]]:
    """The statements of each photo as questions, by its file name; each is asked once.

    One that is labelled both true and false has no answer.
    """
    labels: dict[tuple[str, str], set[int]] = defaultdict(set)
    first: dict[tuple[str, str], Statement] = {}
    for statement in statements:
        key = statement.image, normal_name(statement.caption).strip(" .")
        labels[key].add(statement.label)
        first.setdefault(key, statement)
    answers: dict[str, list[TrueAnswer]] = defaultdict(list)
    for key, statement in first.items():
        own = answers[statement.image]
        number = f"{scene_name(statement.image)}-{len(own) + 1:03}"
        own.append(
            TrueAnswer(
                question=_question(statement, number, vocabulary),
                answer=bool(statement.label) if len(labels[key]) == 1 else None,
                chance=0.5,
            )
        )
    return dict(answers)


def _question(statement: Statement, number: str, vocabulary: Vocabulary) -> Question:
    subject, thing = _named(statement)
    return Question(
        id=number,
        image_id=0,
        kind="yes_no",
        relation=WORDS.get(statement.relation.casefold().strip(), statement.relation),
        text=statement.caption,
        a=_designator(subject, vocabulary),
        b=_designator(thing, vocabulary),
        any=True,
        frame=statement.reference_frame or UNSET,
    )


def _named(statement: Statement) -> tuple[str, str]:
    """The two things of a caption; empty where its relation is not in it."""
    text = normal_name(statement.caption).strip(" .")
    before, found, after = text.partition(f" {normal_name(statement.relation)} ")
    if not found:
        return text, ""
    return _BEFORE.sub("", _BEFORE.sub("", before)), _BEFORE.sub("", after)


def _designator(text: str, vocabulary: Vocabulary) -> Designator:
    category = vocabulary.match(text) or vocabulary.match(text.removesuffix("s"))
    return Designator(category=category.name if category else text)
