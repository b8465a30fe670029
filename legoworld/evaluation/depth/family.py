"""Depth as a family of evaluations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, cast

from legoworld.evaluation.checks import Check
from legoworld.evaluation.depth.evaluate import evaluate_depth
from legoworld.evaluation.depth.text import depth_text, short_depth
from legoworld.evaluation.depth.verification import depth_checks, depth_rows
from legoworld.evaluation.family import EvaluationFamily, EvaluationRequest, Recorded
from legoworld.records.depth import DepthEvidence
from legoworld.records.evaluation_rows import DepthRow
from legoworld.records.evaluation_summary import DepthSummary


def _evaluate(request: EvaluationRequest) -> DepthSummary:
    return evaluate_depth(
        request.run,
        request.truth,
        request.output,
        camera_model=request.options.get("camera_model", "none"),
        draws=request.draws,
        seed=request.seed,
        overwrite=request.overwrite,
        progress=request.progress,
        pool=request.pool,
        origins=request.origins,
    )


def _verify(recorded: Recorded) -> Iterator[Check]:
    evidence = cast("DepthEvidence", recorded.evidence)
    summary, rows = cast("DepthSummary", recorded.summary), cast("list[DepthRow]", recorded.rows)
    yield from depth_checks(recorded.folder, evidence, summary, rows)
    if recorded.inputs_hold:
        yield from depth_rows(recorded.folder, evidence, summary, rows, recorded.root)


EVALUATION: Final = EvaluationFamily(
    evaluate=_evaluate, verify=_verify, short=short_depth, text=depth_text, truth_is_file=False
)
