"""Boxes and masks as a family of evaluations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, cast

from legoworld.evaluation.checks import Check, check_equal
from legoworld.evaluation.detection.amodal_sums import amodal_values, total_sums
from legoworld.evaluation.detection.amodal_text import amodal_tables
from legoworld.evaluation.detection.evaluate import evaluate_detections
from legoworld.evaluation.detection.live import LIVE
from legoworld.evaluation.detection.text import (
    detection_metrics,
    evaluator_lines,
    notes,
    short_detections,
)
from legoworld.evaluation.detection.verification import detection_checks
from legoworld.evaluation.family import EvaluationFamily, EvaluationRequest, RecordedEvaluation
from legoworld.records.base import as_json
from legoworld.records.detection import DetectionEvidence
from legoworld.records.evaluation_rows import DetectionRow
from legoworld.records.evaluation_summary import DetectionSummary
from legoworld.records.folders.read_evaluation import MATCHES


def _evaluate(request: EvaluationRequest) -> DetectionSummary:
    return evaluate_detections(
        request.run,
        request.truth,
        request.output,
        evaluator=request.options.get("evaluator"),
        draws=request.draws,
        seed=request.seed,
        overwrite=request.overwrite,
        notice=request.notice,
        warn=request.warn,
        pool=request.pool,
        origins=request.origins,
    ).summary


def _verify(recorded: RecordedEvaluation) -> Iterator[Check]:
    evidence = cast("DetectionEvidence", recorded.evidence)
    summary = cast("DetectionSummary", recorded.summary)
    yield from detection_checks(recorded.folder, evidence, summary)
    if summary.amodal and summary.amodal.sums:
        sums = [row.amodal for row in cast("list[DetectionRow]", recorded.rows) if row.amodal]
        yield check_equal("amodal sums", as_json(total_sums(sums)), as_json(summary.amodal.sums))
        yield check_equal("amodal metrics", amodal_values(sums), summary.amodal.metrics)


EVALUATION: Final = EvaluationFamily(
    evaluate=_evaluate,
    verify=_verify,
    short=short_detections,
    metrics=detection_metrics,
    head=evaluator_lines,
    notes=notes,
    tables=amodal_tables,
    files=frozenset({MATCHES}),
    live=LIVE,
)
