"""A bench evaluation's numbers made again: the summary from the rows, some rows from the files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from legoworld.cards import load_card
from legoworld.evaluation.checks import Check, find_input
from legoworld.evaluation.evidence import agreement
from legoworld.evaluation.reconstruction.case_tasks import scored_cases, seen_tasks
from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.evaluation.reconstruction.evaluate import case_tasks, second_card
from legoworld.evaluation.reconstruction.protocol import Choices, bench_protocol
from legoworld.evaluation.reconstruction.submission import read_bench_run
from legoworld.evaluation.reconstruction.summary import Settings, summarise
from legoworld.records.base import as_json
from legoworld.records.folders.read_evaluation import SUMMARY
from legoworld.records.reconstruction import BenchEvidence, ReconstructionRow, ReconstructionSummary
from legoworld.workers.tasks import IN_PROCESS

#: Cases scored again, spread evenly over the track.
SCORED_AGAIN: Final = 10


def bench_checks(
    folder: Path,
    evidence: BenchEvidence,
    summary: ReconstructionSummary,
    rows: Sequence[ReconstructionRow],
) -> Iterator[Check]:
    """Means, intervals and counts of the summary against those that follow from the rows."""
    rules = summary.protocol
    again = summarise(
        rows,
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
    # All that the file says: a key that no reader knows follows from no row.
    recomputed, recorded = as_json(again), json.loads((folder / SUMMARY).read_bytes())
    for key in sorted({*recomputed, *recorded}):
        yield agreement(f"{key} from the rows", recomputed.get(key), recorded.get(key))
    raw = {name: mean.value for name, mean in summary.metrics.items()}
    yield agreement("metrics in the evidence", evidence.metrics, raw)


def bench_rows(
    folder: Path, evidence: BenchEvidence, rows: Sequence[ReconstructionRow], root: Path | None
) -> Iterator[Check]:
    """Up to `SCORED_AGAIN` rows, scored again from the run and the private half."""
    run = read_bench_run(_input(folder, evidence, "run", root).parent)
    dataset = read_dataset(_input(folder, evidence, "truth", root).parent)
    asked = evidence.configuration
    choices = Choices(sampling=asked.reference_sampling, diagnostics=asked.diagnostics)
    protocol = bench_protocol(load_card(run.run.task))
    second = second_card(dataset, protocol)
    tasks = case_tasks(run, dataset, protocol, choices, second)
    some = tasks[:: max(1, math.ceil(len(tasks) / SCORED_AGAIN))]
    recorded = {row.image_id: as_json(row) for row in rows}
    for row in scored_cases(seen_tasks(some), IN_PROCESS):
        place = recorded.get(row.image_id)
        yield agreement(f"row of image {row.image_id}", as_json(row), place)


def _input(folder: Path, evidence: BenchEvidence, role: str, root: Path | None) -> Path:
    entry = next(entry for entry in evidence.inputs if entry.role == role)
    path = find_input(folder, entry.path, root)
    assert path is not None
    return path
