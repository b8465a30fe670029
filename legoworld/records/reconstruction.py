"""A bench as a family of records: evidence.json of evaluations and comparisons."""

from __future__ import annotations

from functools import partial
from typing import Final

from legoworld.records.base import decode_lines
from legoworld.records.evaluation_summary import Values
from legoworld.records.evidence import (
    ComparisonEvidence,
    EvaluationEvidence,
    MethodEvidence,
    ScoreConfiguration,
)
from legoworld.records.families import RecordFamily
from legoworld.records.reconstruction_rows import ReconstructionRow
from legoworld.records.reconstruction_summary import (
    ReconstructionCoverage,
    ReconstructionRules,
    ReconstructionSummary,
)


class BenchConfiguration(ScoreConfiguration, frozen=True, kw_only=True):
    """What the numbers of a bench depend on besides the inputs."""

    card_version: str
    reference_sampling: str
    diagnostics: bool


class BenchEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of a bench."""

    coverage: ReconstructionCoverage
    configuration: BenchConfiguration
    protocol: ReconstructionRules
    metrics: Values


class BenchMethod(MethodEvidence, frozen=True, kw_only=True):
    """A side of a bench."""

    configuration: BenchConfiguration
    protocol: ReconstructionRules
    metrics: Values


class BenchComparison(ComparisonEvidence, frozen=True, kw_only=True):
    """Of a comparison of bench runs."""

    methods: tuple[BenchMethod, ...]


RECORDS: Final = RecordFamily(
    summary=ReconstructionSummary,
    rows=partial(decode_lines, ReconstructionRow),
    evidence=BenchEvidence,
    comparison=BenchComparison,
    method=BenchMethod,
)
