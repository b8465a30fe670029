"""Evaluations of any family: summary.json, a line of per_image.jsonl, and evidence.json.

evidence.json: the hashes of what a folder holds and was made from, and its raw numbers. A
`RecordFamily` says which record each file of an evaluation is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import LegoWorldError
from legoworld.records.base import UNSET, Record, RecordError, UnsetType, decode
from legoworld.tasks.registry import find_family

#: Metric -> value; None where the metric is undefined.
Values = dict[str, float | None]


class ImageRow(Record, frozen=True, kw_only=True):
    """One image of an evaluation. status: ok, or why there is nothing to score."""

    image_id: int
    file_name: str
    status: str


class Outcome(NamedTuple):
    """How an image ended, for the coverage bar. words: its status, or a reason in words."""

    sort: Literal["scored", "empty", "failed"]
    words: str


class EvaluationRow(ImageRow, frozen=True, kw_only=True):
    """One image of an evaluation, as every family answers for it."""

    @property
    def has_score(self) -> bool:
        """Whether the image counts as scored."""
        raise NotImplementedError(type(self).__name__)

    @property
    def has_truth(self) -> bool:
        """Whether the image has usable ground truth."""
        raise NotImplementedError(type(self).__name__)

    @property
    def truth_gap(self) -> str:
        """Why the image has no usable ground truth; "" where it has."""
        return "" if self.has_truth else "no truth"

    @property
    def score_gap(self) -> str:
        """Why the image has no score, apart from missing truth; "" where nothing says so."""
        return "" if self.has_score or self.status == "ok" else self.status

    @property
    def outcome(self) -> Outcome:
        """How the image ended."""
        return Outcome("scored" if self.has_score else "failed", self.status)


class Evaluator(Record, frozen=True, kw_only=True):
    """What computed the official numbers."""

    name: str
    version: str


class Interval(Record, frozen=True, kw_only=True):
    """The percentile interval of bootstrap samples; low and high are None when none is defined.

    unit: what is drawn. undefined_draws: samples that left the metric undefined. bootstrap_mean:
    where the samples lay before they were shifted onto the value.
    """

    low: float | None
    high: float | None
    level: float
    unit: str
    draws: int
    undefined_draws: int
    bootstrap_mean: float | UnsetType | None = UNSET

    @property
    def ends(self) -> tuple[float, float] | None:
        """(low, high) where they are defined."""
        return None if self.low is None or self.high is None else (self.low, self.high)


class Coverage(Record, frozen=True, kw_only=True):
    """Images by outcome: the denominators of every number."""

    attempted: int
    scored: int
    with_truth: int
    by_status: dict[str, int]


class MetricValue(NamedTuple):
    """One number of an evaluation. policy: what it is over, where a metric has several."""

    name: str
    policy: str | None
    value: float | None
    interval: Interval | None


class Summary(Record, frozen=True, kw_only=True):
    """What every evaluation says. kind: "scene", or what made the predictions instead."""

    schema_version: int = SCHEMA_VERSION
    task: str
    kind: str | None
    partial: bool
    evaluator: Evaluator
    coverage: Coverage

    def metric_values(self) -> Iterator[MetricValue]:
        """Every metric in display order."""
        raise NotImplementedError(type(self).__name__)


class DepthRules(Record, frozen=True, kw_only=True):
    """The choices of the depth card that decide a number."""

    space: str
    model: str
    solver: str
    disparity_floor: str
    fit_pixels: str
    aggregate: str
    resolution: str
    resample: str
    valid_truth: str
    policies: tuple[str, ...]
    primary: str
    min_valid_px: int


class NotScored(Record, frozen=True, kw_only=True):
    """An image without a score, and why."""

    image_id: int
    file_name: str
    status: str
    reason: str | None


class Input(Record, frozen=True, kw_only=True):
    """A file that was read. path: from the folder, or a whole one where the folder is at a URL.

    without: keys of a JSON file that its hash and size leave out.
    """

    role: str
    sha256: str
    path: str
    bytes: int | UnsetType = UNSET
    without: tuple[str, ...] | UnsetType = UNSET


class OfKind(Record, frozen=True, kw_only=True):
    """A file of several kinds."""

    kind: str


class Evidence(OfKind, frozen=True, kw_only=True):
    """What every evidence.json says. files: sha256 of each other file of the folder, by path.

    inputs, files: the folder's writer fills in those that are empty.
    """

    schema_version: int = SCHEMA_VERSION
    versions: dict[str, str]
    inputs: tuple[Input, ...]
    files: dict[str, str]


class AnyEvidence(Evidence, frozen=True, kw_only=True):
    """evidence.json of any kind, as far as all are alike."""

    configuration: dict[str, str | int | bool | None]


class ScoreConfiguration(Record, frozen=True, kw_only=True):
    """What the numbers of an evaluation depend on besides the inputs; each family adds its own."""

    task: str
    card_sha256: str
    draws: int
    seed: int


class EvaluationEvidence(Evidence, frozen=True, kw_only=True):
    """What every evaluation's evidence says."""

    kind: str = "evaluation"
    task: str
    evaluator: Evaluator
    coverage: Coverage
    configuration: ScoreConfiguration


@dataclass(frozen=True, kw_only=True)
class RecordFamily:
    """The records of a family's evaluations and comparisons.

    rows: the lines of per_image.jsonl, RecordError for others; method: the fields of the evidence
    that a comparison repeats of each side. A file does not name its family: its task does.
    """

    summary: type[Summary]
    rows: Callable[[bytes], Sequence[EvaluationRow]]
    evidence: type[EvaluationEvidence]
    method: tuple[str, ...] = ()


class _OfTask(Record, frozen=True, kw_only=True):
    task: str


def load_record_family(task: str) -> RecordFamily:
    """The records of a task. UsageError, InstallationError."""
    return find_family(task).load("records", RecordFamily)


def decode_summary(data: bytes) -> Summary:
    """The content of a summary.json, by its task. RecordError."""
    return decode(_records_in(data).summary, data)


def decode_evidence(data: bytes) -> EvaluationEvidence:
    """The content of an evaluation's evidence.json, by its task. RecordError."""
    return decode(_records_in(data).evidence, data)


def decode_rows(data: bytes, summary: Summary) -> Sequence[EvaluationRow]:
    """The lines of a per_image.jsonl, by the task of its summary. RecordError."""
    return load_record_family(summary.task).rows(data)


def _records_in(data: bytes) -> RecordFamily:
    task = decode(_OfTask, data).task
    try:
        return load_record_family(task)
    except LegoWorldError as error:
        raise RecordError(str(error)) from error
