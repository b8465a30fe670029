"""One image: its questions, what was answered, the scores of both, and the sums of numbers.

Scores are of answers, of a guess, and of a prior that sees no picture.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from statistics import median
from typing import Any, Final, NamedTuple

from legoworld.evaluation.relations.answering import Reply, answer_by_facts, read_answer
from legoworld.evaluation.relations.truth import TrueImage, Truth, read_answer_file
from legoworld.evaluation.run import Run, read_rows
from legoworld.readouts.relation_kinds import FactBase
from legoworld.records.base import UNSET
from legoworld.records.relations import AnswerFile, RelationsRow, RelationsView, Sums, TrueAnswer
from legoworld.records.run_rows import RunRow
from legoworld.records.track import Answered, Box, Kind, Question, ShownQuestion
from legoworld.tracks.track import scene_name

#: The metric of each kind of answer.
METRIC_OF: Final[Mapping[Kind, str]] = {
    "yes_no": "accuracy",
    "choice": "accuracy",
    "count": "count_exact",
    "number": "mra",
    "refer": "refer_50",
}
#: Lengths are compared in whole micrometres.
_PER_METRE: Final = 1_000_000
#: A truth without the photo.
NO_TRUTH: Final = "the truth asks nothing of this image"


def score(question: Question, truth: Answered, given: Answered | None) -> float:
    """What an answer scores, 0 to 1; 0 for none."""
    if given is None:
        return 0.0
    if question.kind == "number":
        return mean_relative_accuracy(float(given), float(truth))  # type: ignore[arg-type]
    if question.kind == "refer":
        return float(iou(given, truth) >= 0.5)  # type: ignore[arg-type]
    return float(given == truth)


def mean_relative_accuracy(given: float, truth: float) -> float:
    """The share of k = 1 .. 10 with |y - y*| * 20 < k * y* (VSI-Bench), in whole micrometres."""
    y, true = (round(value * _PER_METRE) for value in (given, truth))
    return sum(abs(y - true) * 20 < k * true for k in range(1, 11)) / 10


def iou(a: Box, b: Box) -> float:
    """Of two boxes x, y, width, height; 0 where their union is empty."""
    wide = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    high = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    both = max(0.0, wide) * max(0.0, high)
    union = a[2] * a[3] + b[2] * b[3] - both
    return both / union if union > 0 else 0.0


class Prior:
    """What the same template is answered in other images: a guess at random, and the likeliest.

    Each image is scored by the answers of the others alone.
    """

    def __init__(self, images: Mapping[str, Sequence[TrueAnswer]]) -> None:
        self._counts: dict[tuple[str, str], Counter[Any]] = {}
        self._own: dict[tuple[tuple[str, str], str], Counter[Any]] = {}
        for image, answers in images.items():
            for one in answers:
                if one.answer is not None:
                    template = _template(one.question)
                    self._counts.setdefault(template, Counter())[one.answer] += 1
                    self._own.setdefault((template, image), Counter())[one.answer] += 1

    def scores(self, image: str, one: TrueAnswer) -> tuple[float, float]:
        """Expected scores of a guess and of the likeliest answer."""
        assert one.answer is not None
        kind, truth = one.question.kind, one.answer
        counts = self._others(_template(one.question), image)
        n = counts.total()
        if kind in ("choice", "refer") or not n:
            return one.chance or 0.0, one.chance or 0.0
        scores = {answer: score(one.question, truth, answer) for answer in counts}
        chance = one.chance
        if chance is None:
            chance = sum(scores[answer] * k for answer, k in counts.items()) / n
        if kind == "number":
            return chance, score(one.question, truth, median(counts.elements()))
        most = max(counts.values())
        likeliest = [scores[answer] for answer, k in counts.items() if k == most]
        return chance, sum(likeliest) / len(likeliest)

    def _others(self, template: tuple[str, str], image: str) -> Counter[Any]:
        """The answers of other images, each with how often it was given."""
        return self._counts[template] - self._own.get((template, image), Counter())


def _template(question: Question) -> tuple[str, str]:
    return question.kind, question.relation


def add(sums: dict[str, Sums], name: str, given: float, chance: float, blind: float) -> None:
    """One more question in the sums of a name."""
    old = sums.get(name, Sums(n=0, score=0.0, chance=0.0, blind=0.0))
    sums[name] = Sums(
        n=old.n + 1, score=old.score + given, chance=old.chance + chance, blind=old.blind + blind
    )


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
        yield _score_image(row, scene, truth.images.get(scene), answers, prior)


def _score_image(
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
    found = [base.designated_objects(name) for name in (one.question.a, one.question.b)]
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
