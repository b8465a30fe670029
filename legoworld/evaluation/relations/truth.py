"""What is true of photos: a run of scenes, whose facts are exact, or statements of people.

Statements are in the format of Visual Spatial Reasoning (Liu, Emerson, Collier, TACL 2023): one
JSON object a line, with `image`, `caption`, `relation` and `label`.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.errors import LegoWorldError, cause
from legoworld.evaluation.relations.questions import make_questions
from legoworld.evaluation.run import Run, read_family_run, read_rows
from legoworld.files import sha256_of_file
from legoworld.readouts.family import protocol
from legoworld.records.base import UNSET, RecordError, decode, decode_lines
from legoworld.records.folders.read_run import ROWS
from legoworld.records.relations import AnswerFile, Statement, TrueAnswer
from legoworld.records.run_rows import RunRow
from legoworld.records.track import Designator, Question
from legoworld.tasks.shipped import RELATIONS
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
EXPECTED: Final = (
    "a run of scenes, or JSON Lines of statements as VSR has them: image, caption, relation, label"
)


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


class RelationsTruthError(LegoWorldError):
    """A truth of relations cannot be used."""

    code = "relations_truth"


@dataclass(frozen=True, kw_only=True)
class TrueImage:
    """One photo with its questions. size_wh: None where the truth does not say it."""

    image_id: int
    file_name: str
    size_wh: tuple[int, int] | None
    answers: tuple[TrueAnswer, ...]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Photos by their scene's name. files: role and path of all that it was read from."""

    images: Mapping[str, TrueImage]
    files: tuple[tuple[str, Path], ...]


def read_truth(path: Path, task: str) -> Truth:
    """The questions of a truth with their answers. RelationsTruthError, RunUnusableError."""
    known = protocol(task, None).vocabulary
    assert known is not None  # the card has one
    if path.is_dir():
        return _truth_of_scenes(path, known)
    try:
        statements = decode_lines(Statement, path.read_bytes())
    except (OSError, RecordError) as error:
        raise RelationsTruthError(
            f"{path.name} is no truth of relations", found=cause(error), expected=EXPECTED
        ) from error
    if not statements:
        raise RelationsTruthError(
            f"{path.name} has no statement", found="an empty file", expected=EXPECTED
        )
    images = {}
    answers = statement_answers(statements, known)
    for number, name in enumerate(sorted(answers), start=1):
        images[scene_name(name)] = TrueImage(
            image_id=number, file_name=name, size_wh=None, answers=_of_image(answers[name], number)
        )
    return Truth(images=images, files=(("truth", path),))


def read_answer_file(run: Run, row: RunRow) -> AnswerFile | None:
    """An image's answer; None where it has none. RelationsTruthError for an altered file."""
    if row.answer is UNSET:
        return None
    path = run.folder / row.answer.file
    try:
        if sha256_of_file(path) == row.answer.sha256:
            return decode(AnswerFile, path.read_bytes())
        found = "another sha256"
    except (OSError, RecordError) as error:
        found = cause(error)
    raise RelationsTruthError(
        f"{run.folder.name}/{row.answer.file} is not the one that the run wrote",
        found=found,
        expected=f"the sha256 in {ROWS}",
        next_step="run its command again with --overwrite",
    )


def _truth_of_scenes(path: Path, vocabulary: Vocabulary) -> Truth:
    run = read_family_run(path, RELATIONS, "a run of relations")
    categories = [category.name for category in vocabulary.categories]
    files, images = [("truth", path / ROWS)], {}
    for row in read_rows(run):
        answer, scene = read_answer_file(run, row), scene_name(row.file_name)
        made: list[TrueAnswer] = []
        if answer is not None and row.answer is not UNSET:
            if answer.facts is UNSET:
                raise RelationsTruthError(
                    f"{path.name} is no truth of relations",
                    found="answers to questions",
                    expected=EXPECTED,
                )
            files.append(("truth_facts", path / row.answer.file))
            made = make_questions(answer.facts, scene, row.image_id, categories)
        images[scene] = TrueImage(
            image_id=row.image_id, file_name=row.file_name, size_wh=row.size_wh, answers=tuple(made)
        )
    return Truth(images=images, files=tuple(files))


def _of_image(answers: list[TrueAnswer], image_id: int) -> tuple[TrueAnswer, ...]:
    return tuple(replace(one, question=replace(one.question, image_id=image_id)) for one in answers)
