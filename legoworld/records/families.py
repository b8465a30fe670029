"""The files of an evaluation by its task's family: which record each of them is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from legoworld.errors import LegoWorldError
from legoworld.records.base import Record, RecordError, decode
from legoworld.records.evaluation_rows import EvaluationRow
from legoworld.records.evaluation_summary import Summary
from legoworld.records.evidence import (
    ComparisonEvidence,
    EvaluationEvidence,
    MethodEvidence,
)
from legoworld.tasks.registry import find_family


@dataclass(frozen=True, kw_only=True)
class RecordFamily:
    """The records of a family's evaluations and comparisons.

    rows: the lines of per_image.jsonl, RecordError for others. A file does not name its family:
    its task does.
    """

    summary: type[Summary]
    rows: Callable[[bytes], Sequence[EvaluationRow]]
    evidence: type[EvaluationEvidence]
    comparison: type[ComparisonEvidence] = ComparisonEvidence
    method: type[MethodEvidence] = MethodEvidence


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
