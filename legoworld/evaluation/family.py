"""The evaluation of a family: how runs are scored, checked again, and told in a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from legoworld.evaluation.checks import Check
from legoworld.evaluation.metrics import MetricPart, metric_parts, metric_tables
from legoworld.evaluation.prepare_inputs import HERE, Origins
from legoworld.records.evaluation_rows import EvaluationRow
from legoworld.records.evaluation_summary import Summary
from legoworld.records.evidence import EvaluationEvidence
from legoworld.tables.table import Table
from legoworld.tables.terminal import terminal, within_width
from legoworld.tasks.registry import find_family
from legoworld.workers.tasks import IN_PROCESS, WorkerPool


def _ignore(_what: object) -> None:
    """Drop what is said."""


def _nothing(_summary: object) -> list[Any]:
    return []


@dataclass(frozen=True, kw_only=True)
class EvaluationRequest:
    """A run to score against a truth into an output folder.

    options: the family's own parameters that were given; progress: called with each row, in image
    order, where images are scored one by one; notice is told what is being done, warn what the
    reader of the numbers must know. pool: works on the images; any pool gives the same bytes.
    """

    run: Path
    truth: Path
    output: Path
    draws: int
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)
    overwrite: bool = False
    progress: Callable[[Any], None] = _ignore
    notice: Callable[[str], None] = _ignore
    warn: Callable[[str], None] = _ignore
    pool: WorkerPool = IN_PROCESS
    origins: Origins = HERE


@dataclass(frozen=True, kw_only=True)
class RecordedEvaluation:
    """A finished evaluation that is checked. root: where moved inputs are looked for.

    inputs_hold: whether every input is there and is what was scored.
    """

    folder: Path
    evidence: EvaluationEvidence
    summary: Summary
    rows: Sequence[EvaluationRow]
    root: Path | None
    inputs_hold: bool


@dataclass(frozen=True, kw_only=True)
class EvaluationFamily:
    """How answers of one kind are scored.

    evaluate: writes the evaluation folder; every LegoWorldError is raised before anything is
    written. verify: makes the numbers again from what the folder and its inputs hold, at least from
    its rows. short: a few lines. metrics: every number of a summary; tables: more tables of one;
    head: stands above them in place of the first short line; notes: sentences about what the
    numbers are over. files: what an evaluation must hold besides summary, rows and run. photos:
    whether its page shows the track's photos, which --photos names; truth_is_file: whether --truth
    names the truth itself, and no folder of it.
    """

    evaluate: Callable[[EvaluationRequest], Summary]
    verify: Callable[[RecordedEvaluation], Iterator[Check]]
    short: Callable[[Any], str]
    metrics: Callable[[Any], Sequence[MetricPart]] = metric_parts
    tables: Callable[[Any], Sequence[Table]] = _nothing
    head: Callable[[Any], str] | None = None
    notes: Callable[[Any], Sequence[str]] = _nothing
    files: frozenset[str] = frozenset()
    photos: bool = True
    truth_is_file: bool = True


def load_evaluation_family(task: str) -> EvaluationFamily:
    """The evaluation of a task. UsageError, InstallationError."""
    return find_family(task).load("evaluation", EvaluationFamily)


def evaluation_text(summary: Summary) -> str:
    """Everything that an evaluation says of itself, for a terminal."""
    family = load_evaluation_family(summary.task)
    tables = [*metric_tables([("", family.metrics(summary))]), *family.tables(summary)]
    head = family.head(summary) if family.head else family.short(summary).split("\n", 1)[0]
    parts = [head, *map(terminal, tables), "\n".join(family.notes(summary))]
    return within_width("\n\n".join(filter(None, parts)))
