"""Boxes and masks as a family of records: evidence.json of evaluations and comparisons."""

from __future__ import annotations

from functools import partial
from typing import Final

from legoworld.records.base import Record, decode_lines
from legoworld.records.evaluation_rows import DetectionRow
from legoworld.records.evaluation_summary import DetectionCoverage, DetectionSummary
from legoworld.records.evidence import (
    EvaluationEvidence,
    RecordFamily,
    ScoreConfiguration,
)


class DetectionConfiguration(ScoreConfiguration, frozen=True, kw_only=True):
    """What the numbers of boxes and masks depend on besides the inputs."""

    evaluator: str


class RunOrigin(Record, frozen=True, kw_only=True):
    """What a run says of itself: what it read, and the hashes of what it was for."""

    kind: str | None
    source: str | None
    track_sha256: str | None
    images_sha256: str | None
    vocabulary_sha256: str | None


class CardOrigin(Record, frozen=True, kw_only=True):
    """The readout card that was scored by."""

    task: str
    card_version: str
    card_sha256: str


class RawScores(Record, frozen=True, kw_only=True):
    """The evaluator's own numbers and lines, and the hash of the results it was given."""

    official: tuple[float, ...]
    lines: tuple[str, ...]
    prediction_order: str
    canonical_predictions_sha256: str


class EqualScores(Record, frozen=True, kw_only=True):
    """The evaluator's own numbers of the same predictions, none ranked above another."""

    official: tuple[float, ...]
    predictions_sha256: str


class DetectionEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of boxes and masks."""

    coverage: DetectionCoverage
    configuration: DetectionConfiguration
    run: RunOrigin
    protocol: CardOrigin
    raw: RawScores
    equal_confidence: EqualScores


RECORDS: Final = RecordFamily(
    summary=DetectionSummary,
    rows=partial(decode_lines, DetectionRow),
    evidence=DetectionEvidence,
    method=("configuration", "run", "protocol", "raw", "equal_confidence"),
)
