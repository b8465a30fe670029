"""Reconstruction as a family of evaluations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, cast

from legoworld.evaluation.checks import Check
from legoworld.evaluation.family import EvaluationFamily, EvaluationRequest, RecordedEvaluation
from legoworld.evaluation.reconstruction.evaluate import evaluate_bench
from legoworld.evaluation.reconstruction.protocol import Choices
from legoworld.evaluation.reconstruction.text import (
    bench_metrics,
    bench_notes,
    group_tables,
    short_bench,
)
from legoworld.evaluation.reconstruction.verification import bench_checks, bench_rows
from legoworld.records.reconstruction import BenchEvidence, ReconstructionRow, ReconstructionSummary


def _evaluate(request: EvaluationRequest) -> ReconstructionSummary:
    return evaluate_bench(
        request.run,
        request.truth,
        request.output,
        choices=Choices(
            sampling=request.options.get("reference_sampling", "raster"),
            diagnostics=request.options.get("diagnostics", True),
        ),
        draws=request.draws,
        seed=request.seed,
        overwrite=request.overwrite,
        progress=request.progress,
        pool=request.pool,
        origins=request.origins,
    )


def _verify(recorded: RecordedEvaluation) -> Iterator[Check]:
    evidence = cast("BenchEvidence", recorded.evidence)
    summary = cast("ReconstructionSummary", recorded.summary)
    rows = cast("list[ReconstructionRow]", recorded.rows)
    yield from bench_checks(recorded.folder, evidence, summary, rows)
    if recorded.inputs_hold:
        yield from bench_rows(recorded.folder, evidence, rows, recorded.root)


EVALUATION: Final = EvaluationFamily(
    evaluate=_evaluate,
    verify=_verify,
    short=short_bench,
    metrics=bench_metrics,
    tables=group_tables,
    notes=bench_notes,
    photos=False,
)
