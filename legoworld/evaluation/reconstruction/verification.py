"""A bench evaluation's numbers made again: the summary from the rows, some rows from the files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, cast

from legoworld.cards import load_card
from legoworld.evaluation.checks import Check
from legoworld.evaluation.evidence import agreement, check_summary
from legoworld.evaluation.family import RecordedEvaluation
from legoworld.evaluation.reconstruction.case_tasks import scored_cases, seen_tasks
from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.evaluation.reconstruction.evaluate import case_tasks, second_card
from legoworld.evaluation.reconstruction.protocol import Choices, bench_protocol
from legoworld.evaluation.reconstruction.submission import read_bench_run
from legoworld.evaluation.reconstruction.summary import Settings, summarise
from legoworld.records.base import as_json
from legoworld.records.reconstruction import BenchEvidence, ReconstructionRow, ReconstructionSummary
from legoworld.workers.tasks import IN_PROCESS

#: Cases scored again, spread evenly over the track.
SCORED_AGAIN: Final = 10


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
    some = tasks[:: max(1, math.ceil(len(tasks) / SCORED_AGAIN))]
    stored = {row.image_id: as_json(row) for row in recorded.rows}
    for row in scored_cases(seen_tasks(some), IN_PROCESS):
        yield agreement(f"row of image {row.image_id}", as_json(row), stored.get(row.image_id))
