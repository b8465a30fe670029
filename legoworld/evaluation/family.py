"""The evaluation of a family: how runs are scored, checked again, and told in a terminal."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import Card
from legoworld.evaluation.checks import Check, find_input
from legoworld.evaluation.metrics import MetricPart, metric_parts, metric_tables
from legoworld.evaluation.run import Run
from legoworld.files import Json
from legoworld.readouts.pixels import PixelFile
from legoworld.records.evaluation import (
    EvaluationEvidence,
    EvaluationRow,
    ScoreConfiguration,
    Summary,
)
from legoworld.records.folders.evaluation_folder import InputFile, input_file, prepare_folder
from legoworld.remote import child
from legoworld.tables.table import Table
from legoworld.tables.terminal import terminal, within_width
from legoworld.tasks.registry import find_family
from legoworld.workers.tasks import IN_PROCESS, WorkerPool

C = TypeVar("C", bound=ScoreConfiguration)


@dataclass(frozen=True, kw_only=True)
class Origins:
    """The URLs of the run that is scored and of the evaluation; None where it is a folder here."""

    run_url: str | None = None
    output_url: str | None = None


#: Nothing is a copy.
HERE = Origins()


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

    run: Run
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


def make_configuration(
    request: EvaluationRequest, card: Card, kind: Callable[..., C], **own: Json
) -> C:
    """What the numbers depend on besides the inputs. own: fields of the family's kind alone."""
    draws, seed = request.draws, request.seed
    return kind(task=card.task, card_sha256=card.sha256, draws=draws, seed=seed, **own)


def prepare_inputs(
    request: EvaluationRequest,
    files: Sequence[tuple[str, Path]],
    configuration: ScoreConfiguration,
) -> list[InputFile]:
    """Hash the files that a score depends on and prepare the evaluation folder for them.

    files: role and path of each, as it lies here. A file of a run at a URL is named by its own URL,
    which remains valid after the copy is deleted. Where the evaluation goes to a URL, a file of
    this machine has no path relative to it, and is named by its whole path. Raises as
    `prepare_folder` does.
    """
    folder, origins = request.run.folder, request.origins
    inputs = [
        replace(input_file(role, path), recorded=_recorded_path(path, folder, origins))
        for role, path in files
    ]
    prepare_folder(
        request.output, configuration=configuration, inputs=inputs, overwrite=request.overwrite
    )
    return inputs


def _recorded_path(path: Path, run: Path, origins: Origins) -> str | None:
    if origins.run_url is not None and path.is_relative_to(run):
        # Strip credentials from the URL.
        url = re.sub(r"(?<=://)[^/@]*@", "", origins.run_url)
        return child(url, path.relative_to(run).as_posix())
    return path.resolve().as_posix() if origins.output_url is not None else None


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

    def input(self, role: str) -> Path:
        """The first input of a role, as it lies here; asked for where `inputs_hold`."""
        entry = next(entry for entry in self.evidence.inputs if entry.role == role)
        path = find_input(self.folder, entry.path, self.root)
        assert path is not None
        return path


Picture = NDArray[np.float32] | NDArray[np.float64]
#: Results as in a results file, or arrays by image id.
LiveAnswers = Sequence[Mapping[str, Json]] | Mapping[int, Picture]
#: A truth's file, one array, or arrays by image id.
LiveTruth = str | Path | Picture | Mapping[int, Picture]


@dataclass(frozen=True, kw_only=True)
class Scores:
    """The numbers of answers in memory. evaluator: the official one's name and version.

    metrics: fractions by the official names, None where undefined; of a family by policy, under the
    primary policy, and by_policy has all. per_image: rows of such a family, by image id.
    """

    task: str
    evaluator: str
    n_images: int
    metrics: Mapping[str, float | None]
    by_policy: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    per_image: Sequence[EvaluationRow] = ()

    @property
    def table(self) -> list[dict[str, str | float | None]]:
        """One row of plain values per metric: `pandas.DataFrame(scores.table)`."""
        return [
            {"task": self.task, "metric": name, "policy": policy, "value": own}
            for name, value in self.metrics.items()
            for policy, own in self.by_policy.get(name, {"": value}).items()
        ]

    def __repr__(self) -> str:
        numbers = ", ".join(f"{k} {v:.3f}" for k, v in self.metrics.items() if v is not None)
        return f"<Scores of {self.task}, {self.n_images} images: {numbers or 'undefined'}>"


@dataclass(frozen=True, kw_only=True)
class LiveFamily:
    """How answers in memory are scored, with nothing written.

    open: a task's whole ground truth, from its file or from arrays by image id; sizes_wh: of its
    images by id. score: task, truth, answers, and the images they are of, None for all of them.
    Answers are results, or arrays by image id; stored: how a file keeps such an array.
    """

    open: Callable[[str, LiveTruth], Any]
    sizes_wh: Callable[[Any], Mapping[int, tuple[int, int]]]
    score: Callable[[str, Any, LiveAnswers, Collection[int] | None], Scores]
    stored: PixelFile | None = None


@dataclass(frozen=True, kw_only=True)
class EvaluationFamily:
    """How answers of one kind are scored.

    evaluate: writes the evaluation folder; every LegoWorldError is raised before anything is
    written. verify: makes the numbers again from what the folder and its inputs hold, at least from
    its rows. short: a few lines. metrics: every number of a summary; tables: more tables of one;
    head: stands above them in place of the first short line; notes: sentences about what the
    numbers are over. files: what an evaluation must hold besides summary, rows and run. photos:
    whether its page shows the track's photos, which --photos names; truth_is_file: whether --truth
    names the truth itself, and no folder of it. live: scoring in memory, None where there is none.
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
    live: LiveFamily | None = None


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
