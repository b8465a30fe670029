"""Depth as a family of records: evidence.json of evaluations and comparisons."""

from __future__ import annotations

from typing import Final

from legoworld.records.evaluation_rows import depth_rows
from legoworld.records.evaluation_summary import DepthChoices, DepthCoverage, DepthSummary, Means
from legoworld.records.evidence import (
    ComparisonEvidence,
    EvaluationEvidence,
    MethodEvidence,
    ScoreConfiguration,
)
from legoworld.records.families import RecordFamily


class DepthConfiguration(ScoreConfiguration, frozen=True, kw_only=True):
    """What the numbers of depth depend on besides the inputs."""

    card_version: str
    camera_model: str


class DepthEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of depth."""

    coverage: DepthCoverage
    configuration: DepthConfiguration
    protocol: DepthChoices
    metrics: Means


class DepthMethod(MethodEvidence, frozen=True, kw_only=True):
    """A side of depth."""

    configuration: DepthConfiguration
    protocol: DepthChoices
    metrics: Means


class DepthComparison(ComparisonEvidence, frozen=True, kw_only=True):
    """Of a comparison of depth."""

    methods: tuple[DepthMethod, ...]


RECORDS: Final = RecordFamily(
    summary=DepthSummary,
    rows=depth_rows,
    evidence=DepthEvidence,
    comparison=DepthComparison,
    method=DepthMethod,
)
