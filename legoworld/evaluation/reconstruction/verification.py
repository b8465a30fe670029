"""A bench evaluation's numbers made again: the summary from the rows, some rows from the files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import cast

from legoworld.cards import load_card
from legoworld.evaluation.checks import Check
from legoworld.evaluation.evidence import agreement, check_rows, check_summary, spread_evenly
from legoworld.evaluation.family import RecordedEvaluation
from legoworld.evaluation.reconstruction.case_tasks import scored_cases, seen_tasks
from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.evaluation.reconstruction.evaluate import case_tasks, second_card
from legoworld.evaluation.reconstruction.protocol import Choices, bench_protocol
from legoworld.evaluation.reconstruction.submission import read_bench_run
from legoworld.evaluation.reconstruction.summary import Settings, summarise
from legoworld.records.reconstruction import BenchEvidence, ReconstructionRow, ReconstructionSummary
from legoworld.workers.tasks import IN_PROCESS


def verify_bench(recorded: RecordedEvaluation) -> Iterator[Check]:
    """The summary against the one that follows from the rows, and rows from run and dataset.

    Up to `SCORED_AGAIN` rows are scored again where run and private half are here.
    """
    summary = cast("ReconstructionSummary", recorded.summary)
    rules = summary.protocol
    again = summarise(
        cast("Sequence[ReconstructionRow]", recorded.rows),
        kind=str(summary.kind),
        partial=summary.partial,
        protocol=bench_protocol(load_card(summary.task)),
        settings=Settings(
            choices=Choices(sampling=rules.reference_sampling, diagnostics=rules.diagnostics),
            sampled=rules.reference_points == "raster" or rules.reference_sampling != "raster",
            draws=summary.bootstrap.draws,
            seed=summary.bootstrap.seed,
        ),
    )
    yield from check_summary(recorded, again)
    raw = {name: mean.value for name, mean in summary.metrics.items()}
    evidence = cast("BenchEvidence", recorded.evidence)
    yield agreement("metrics in the evidence", evidence.metrics, raw)
    if recorded.inputs_hold:
        yield from _rescore_cases(recorded, evidence)


def _rescore_cases(recorded: RecordedEvaluation, evidence: BenchEvidence) -> Iterator[Check]:
    run = read_bench_run(recorded.input("run").parent)
    dataset = read_dataset(recorded.input("truth").parent)
    asked = evidence.configuration
    choices = Choices(sampling=asked.reference_sampling, diagnostics=asked.diagnostics)
    protocol = bench_protocol(load_card(run.run.task))
    second = second_card(dataset, protocol)
    tasks = case_tasks(run, dataset, protocol, choices, second)
    again = scored_cases(seen_tasks(spread_evenly(tasks)), IN_PROCESS)
    yield from check_rows(recorded, again)
