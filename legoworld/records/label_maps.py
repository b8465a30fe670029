"""Evaluations of label maps: rows, summary and evidence.json of panoptic and semantic answers."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

from legoworld.records.base import Record, decode_lines
from legoworld.records.evaluation import (
    EvaluationEvidence,
    EvaluationRow,
    Interval,
    MetricValue,
    RecordFamily,
    Summary,
    Values,
)


class MatchedSegment(Record, frozen=True, kw_only=True):
    """A true positive: ids of both segments, and the pixels of which its IoU is the ratio."""

    category_id: int
    truth: int
    answer: int
    intersection: int
    union: int


class LabelMapRow(EvaluationRow, frozen=True, kw_only=True):
    """One image. n_truth: true segments that are no crowd, or classes.

    counts: of each category id that the image has; panoptic: TP, FP, FN; semantic: pixels of
    intersection, truth and answer. matched: of segments, by ids of truth and answer.
    """

    reason: str | None
    n_truth: int
    counts: dict[str, tuple[int, int, int]]
    matched: tuple[MatchedSegment, ...] = ()

    @property
    def has_score(self) -> bool:
        """Whether the run answered for it; without an answer all of its truth is missed."""
        return self.status == "ok"

    @property
    def has_truth(self) -> bool:
        """Whether something of it is scored."""
        return self.n_truth > 0


class MapCategory(Record, frozen=True, kw_only=True):
    """A category that some image has, with its numbers over all images."""

    id: int
    name: str
    isthing: bool
    counts: tuple[int, int, int]
    values: Values


class MapBootstrap(Record, frozen=True, kw_only=True):
    """How intervals were drawn, over images."""

    draws: int
    seed: int


class LabelMapSummary(Summary, frozen=True, kw_only=True):
    """Of label maps. missed: images without an answer, all of whose truth counts as missed."""

    dataset_version: str
    metrics: Values
    intervals: dict[str, Interval]
    bootstrap: MapBootstrap
    categories: tuple[MapCategory, ...]
    missed: int
    not_answered: tuple[str, ...]

    def metric_values(self) -> Iterator[MetricValue]:
        """The metrics in display order."""
        for name, value in self.metrics.items():
            yield MetricValue(name, None, value, self.intervals.get(name))


class LabelMapEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of label maps."""

    metrics: Values


class LabelMapView(Record, frozen=True, kw_only=True):
    """view/ID.json: small pictures of ground truth, answer and where their categories agree.

    Each is base64 of a PNG; size_wh: of the image.
    """

    size_wh: tuple[int, int]
    truth: str
    answer: str
    agreement: str


RECORDS: Final = RecordFamily(
    summary=LabelMapSummary,
    rows=partial(decode_lines, LabelMapRow),
    evidence=LabelMapEvidence,
    method=("configuration", "metrics"),
)
