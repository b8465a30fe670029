"""One image: its questions, what was answered, and the sums that every number is made of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final, NamedTuple

from legoworld.evaluation.relations.answering import Reply, answer_by_facts, read_answer
from legoworld.evaluation.relations.scores import METRIC_OF, Prior, add, score
from legoworld.evaluation.relations.truth import TrueImage, Truth, read_answer_file
from legoworld.evaluation.run import Run, read_rows
from legoworld.readouts.relation_kinds import FactBase
from legoworld.records.base import UNSET
from legoworld.records.relations import AnswerFile, RelationsRow, RelationsView, Sums, TrueAnswer
from legoworld.records.run_rows import RunRow
from legoworld.records.track import Answered, ShownQuestion
from legoworld.tracks.track import scene_name

#: A truth without the photo.
NO_TRUTH: Final = "the truth asks nothing of this image"


class ScoredImage(NamedTuple):
    """A row, and its questions for the page."""

    row: RelationsRow
    view: RelationsView


def scored_images(run: Run, truth: Truth) -> Iterator[ScoredImage]:
    """Every image of a run, ascending id. RelationsTruthError for an altered answer."""
    prior = Prior({name: image.answers for name, image in truth.images.items()})
    for row in read_rows(run):
        scene = scene_name(row.file_name)
        answers = read_answer_file(run, row) if row.status == "ok" else None
        yield _scored(row, scene, truth.images.get(scene), answers, prior)


def _scored(
    row: RunRow, scene: str, image: TrueImage | None, file: AnswerFile | None, prior: Prior
) -> ScoredImage:
    asked = image.answers if image is not None else ()
    sums: dict[str, Sums] = {}
    relations: dict[str, Sums] = {}
    why: Counter[str] = Counter()
    shown = []
    base = FactBase(file.facts) if file is not None and file.facts is not UNSET else None
    for one in asked:
        reply = _reply(one, file, base)
        points = None
        if one.answer is not None:
            points = score(one.question, one.answer, reply.value)
            _count(sums, relations, one, reply, points, prior.scores(scene, one))
            if reply.value is None:
                why[reply.why] += 1
        boxes = one.boxes or _own_boxes(one, base)
        shown.append(
            ShownQuestion(
                id=one.question.id,
                text=one.question.text,
                truth="contradictory" if one.answer is None else _words(one.answer),
                answer=f"unknown: {reply.why}" if reply.value is None else _words(reply.value),
                score=points,
                boxes=boxes,
            )
        )
    n_true = sum(one.answer is not None for one in asked)
    return ScoredImage(
        RelationsRow(
            image_id=row.image_id,
            file_name=row.file_name,
            status=row.status,
            n_true=n_true,
            n_answered=n_true - why.total(),
            contradictory=len(asked) - n_true,
            why=dict(sorted(why.items())),
            sums=sums,
            by_relation=relations,
            reason=row.reason if asked else row.reason or NO_TRUTH,
        ),
        RelationsView(size_wh=_size(row, image, base), questions=tuple(shown)),
    )


def _reply(one: TrueAnswer, file: AnswerFile | None, base: FactBase | None) -> Reply:
    if base is not None:
        return answer_by_facts(one.question, base)
    if file is None or file.answers is UNSET:
        return Reply(None, "failed_image")
    return read_answer(one.question, file.answers.get(one.question.id))


def _count(
    sums: dict[str, Sums],
    relations: dict[str, Sums],
    one: TrueAnswer,
    reply: Reply,
    points: float,
    guesses: tuple[float, float],
) -> None:
    metric, answered = METRIC_OF[one.question.kind], reply.value is not None
    add(sums, metric, points, *guesses)
    add(sums, "answered", float(answered), 1.0, 1.0)
    if metric == "accuracy":
        add(relations, one.question.relation, points, *guesses)
        if answered:
            add(sums, "accuracy_answered", points, *guesses)
    if one.question.kind == "count" and isinstance(reply.value, int):
        error = abs(reply.value - one.answer)  # type: ignore[operator]
        add(sums, "count_error", float(error), 0.0, 0.0)


def _own_boxes(one: TrueAnswer, base: FactBase | None) -> tuple[tuple[int, int, int, int], ...]:
    """The boxes of what a statement names, where a scene has one of each."""
    if base is None or one.question.b is None:
        return ()
    found = [base.named(name) for name in (one.question.a, one.question.b)]
    return tuple(things[0].bbox_xywh_px for things in found) if all(found) else ()


def _size(row: RunRow, image: TrueImage | None, base: FactBase | None) -> tuple[int, int] | None:
    if image is not None and image.size_wh is not None:
        return image.size_wh
    return base.facts.size_wh if base is not None else row.size_wh


def _words(value: Answered) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.2f}"
    if isinstance(value, tuple | list):
        return ", ".join(f"{v:g}" for v in value)
    return str(value)
