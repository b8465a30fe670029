"""Reconstruction as a family of evaluations."""

from __future__ import annotations

from typing import Final

from legoworld.evaluation.family import EvaluationFamily
from legoworld.evaluation.reconstruction.evaluate import evaluate_bench
from legoworld.evaluation.reconstruction.text import (
    bench_metrics,
    bench_notes,
    group_tables,
    short_bench,
)
from legoworld.evaluation.reconstruction.verification import verify_bench

EVALUATION: Final = EvaluationFamily(
    evaluate=evaluate_bench,
    verify=verify_bench,
    short=short_bench,
    metrics=bench_metrics,
    tables=group_tables,
    notes=bench_notes,
    photos=False,
)
