"""Relations: the facts of a scene, questions about a picture, their answers, and how they score."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Annotated

from msgspec import Meta, field

from legoworld.records.base import UNSET, Record, UnsetType, decode_lines
from legoworld.records.evaluation import (
    EvaluationEvidence,
    EvaluationRow,
    Interval,
    MetricValue,
    RecordFamily,
    ScoreConfiguration,
    Summary,
)
from legoworld.records.track import Answered, Box, Question, ShownQuestion

Vector = tuple[float, float, float]
Column = tuple[float, ...]
#: A number for each pair, None where it is unknown.
Holed = tuple[float | None, ...]


class FactObject(Record, frozen=True, kw_only=True):
    """One labelled and visible instance.

    visible: the share of its silhouette inside the picture that is seen; centre_cam_m: the middle
    of its extent in the camera's frame; size_m: of its box in the world, x, y and z (its height).
    """

    id: int
    name: str
    category: str
    area_px: int
    bbox_xywh_px: tuple[int, int, int, int]
    visible: float
    centre_cam_m: Vector
    size_m: Vector


class FactPairs(Record, frozen=True, kw_only=True):
    """Columns over pairs of objects, by their ids: a before b, in ascending order.

    left_m, above_m, front_m: the gap between their extents: above 0 where a is left of, above, in
    front of b, below 0 where b is, 0 where they overlap or the picture says otherwise. centre_m:
    between their middles; surface_m: between their surfaces, None where it is at least apart_m, the
    distance of their boxes. near_m: the distance up to which they are near. depth_m: how deep they
    reach into each other, None where their surfaces do not meet.
    Of a towards b, and of b towards a: gap_*_m where one rests on the other in balance; inside_*:
    the share of one in the other's convex hull, up to a half in its box; within_*: where that is
    INSIDE or more, the share in its volume, None where that is not closed; under_*_m: how far
    straight below; angle_*_deg: between one's front and the way to the other; hidden_*: the share
    of one that the other hides.
    """

    a: tuple[int, ...]
    b: tuple[int, ...]
    left_m: Column
    above_m: Column
    front_m: Column
    centre_m: Column
    apart_m: Column
    near_m: Column
    surface_m: Holed
    depth_m: Holed
    gap_ab_m: Holed
    gap_ba_m: Holed
    inside_ab: Holed
    inside_ba: Holed
    within_ab: Holed
    within_ba: Holed
    under_ab_m: Column
    under_ba_m: Column
    angle_ab_deg: Holed
    angle_ba_deg: Holed
    hidden_ab: Column
    hidden_ba: Column


class Facts(Record, frozen=True, kw_only=True):
    """What holds between the objects of one picture. left_out: objects beyond the bound."""

    size_wh: tuple[int, int]
    objects: tuple[FactObject, ...]
    pairs: FactPairs
    left_out: int = 0


class TrueAnswer(Record, frozen=True, kw_only=True):
    """A question with its answer. answer: None where labels contradict each other.

    chance: the score of a guess, where the question's form decides it; boxes: of the two things.
    """

    question: Question
    answer: Answered | None
    chance: float | None = None
    boxes: tuple[Box, ...] = ()


class Statement(Record, frozen=True, kw_only=True):
    """A line of VSR's files, as far as it is read. label: 1 where the caption is true."""

    image: str
    caption: str
    label: Annotated[int, Meta(ge=0, le=1)]
    relation: str
    reference_frame: str | None = None


class AnswerLine(Record, frozen=True, kw_only=True):
    """A line of answers.jsonl."""

    id: str
    answer: bool | int | float | str | list[int | float] | None


class AnswerFile(Record, frozen=True, kw_only=True):
    """An image's answer: the facts of a scene, or what was answered, by question."""

    facts: Facts | UnsetType = UNSET
    answers: dict[str, bool | int | float | str | list[int | float] | None] | UnsetType = UNSET


class Sums(Record, frozen=True, kw_only=True):
    """Sums over an image's questions. score: of the answers; chance, blind: of those guesses."""

    n: int
    score: float
    chance: float
    blind: float


class RelationsView(Record, frozen=True, kw_only=True):
    """view/ID.json: every question of an image."""

    size_wh: tuple[int, int] | None
    questions: tuple[ShownQuestion, ...]


class RelationsRow(EvaluationRow, frozen=True, kw_only=True):
    """One image. sums: by metric; by_relation: of accuracy; why: unanswered, by reason.

    n_true: questions with a true answer; n_answered: of these, those with a readable answer.
    """

    n_true: int
    n_answered: int
    contradictory: int
    why: dict[str, int]
    sums: dict[str, Sums]
    by_relation: dict[str, Sums]
    reason: str | None = None

    @property
    def has_score(self) -> bool:
        """Whether any question of it has an answer."""
        return self.status == "ok" and self.n_true > 0

    @property
    def has_truth(self) -> bool:
        """Whether any question of it has a true answer."""
        return self.n_true > 0


class Metric(Record, frozen=True, kw_only=True):
    """One metric by what answers: the run, a guess, and a prior that sees no picture."""

    n: int
    answers: float | None
    chance: float | None
    blind: float | None
    interval: Interval | None


class RelationsSummary(Summary, frozen=True, kw_only=True):
    """Of relations. relations: the accuracy of each; unanswered: questions by reason."""

    metrics: dict[str, Metric]
    relations: dict[str, Metric]
    unanswered: dict[str, int]
    contradictory: int

    def metric_values(self) -> Iterator[MetricValue]:
        """Every metric of the answers, then of a guess and of the prior."""
        for name, metric in self.metrics.items():
            yield MetricValue(name, "answers", metric.answers, metric.interval)
            yield MetricValue(name, "chance", metric.chance, None)
            yield MetricValue(name, "blind", metric.blind, None)


class RelationsEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of relations."""

    configuration: ScoreConfiguration
    metrics: dict[str, Metric] = field(default_factory=dict)


RECORDS = RecordFamily(
    summary=RelationsSummary, rows=partial(decode_lines, RelationsRow), evidence=RelationsEvidence
)
