"""evidence.json: the hashes of what a folder holds and was made from, and its raw numbers.

A `RecordFamily` says which record each file of an evaluation is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import LegoWorldError
from legoworld.records.base import UNSET, Record, RecordError, UnsetType, decode
from legoworld.records.comparison import KIND, PairHead
from legoworld.records.evaluation_rows import EvaluationRow
from legoworld.records.evaluation_summary import Coverage, Evaluator, Summary
from legoworld.tasks.registry import find_family


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


class ComparisonSettings(Record, frozen=True, kw_only=True):
    """What the numbers of a comparison depend on besides the evaluations."""

    draws: int
    seed: int
    allow_truth_prompts: bool


class PairedNumbers(Record, frozen=True, kw_only=True):
    """A metric over the paired images."""

    scene: float | None
    baseline: float | None
    difference: float | None


class PairEvidence(PairHead, frozen=True, kw_only=True):
    """Two methods and their numbers over the paired images, by metric."""

    paired_metrics: dict[str, PairedNumbers]


class ComparisonEvidence(Evidence, frozen=True, kw_only=True):
    """Of a comparison. methods: each side's name, and of its own evidence what its family says.

    pairs: filled in when the numbers are made.
    """

    kind: str = KIND
    task: str
    configuration: ComparisonSettings
    methods: tuple[dict[str, Any], ...]
    pairs: tuple[PairEvidence, ...] = ()


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
