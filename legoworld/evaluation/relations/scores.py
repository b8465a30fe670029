"""Scores of answers, of a guess, and of a prior that sees no picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, Final

from legoworld.records.relations import Sums, TrueAnswer
from legoworld.records.track import Answered, Box, Kind, Question

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
