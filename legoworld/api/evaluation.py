"""`evaluate`: score a run against private ground truth."""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Generic, Literal, TypedDict, Unpack, cast, overload

from legoworld.api.arguments import check_argument, check_arguments
from legoworld.api.by_task import (
    ByTask,
    refuse_result_at,
    task_folder,
)
from legoworld.api.folders import parse_place, read_from, written_whole
from legoworld.api.listener import SILENT, Listener
from legoworld.errors import LegoWorldError, UsageError
from legoworld.evaluation.detection.evaluators import EvaluatorKind
from legoworld.evaluation.family import EvaluationRequest, Origins, load_evaluation_family
from legoworld.evaluation.run import read_run
from legoworld.records.base import as_json
from legoworld.records.evaluation import Coverage, Summary
from legoworld.records.folders.read_evaluation import EVIDENCE, read_image_rows, read_summary
from legoworld.remote import Place
from legoworld.tasks.registry import find_family, options_by_task, require_task
from legoworld.tasks.shipped import NumberTask, PolicyTask
from legoworld.workers.engines import EngineName, engine_cores
from legoworld.workers.tasks import WorkerPool

#: Values of a family's metrics, and of one whose metrics have a value by hole policy.
Numbers = dict[str, float | None]
NumbersByPolicy = dict[str, Numbers]
if TYPE_CHECKING:
    from typing_extensions import TypeVar

    from legoworld.api.scoring import Answers, Truth
    from legoworld.evaluation.family import LiveTruth

    _Run = str | Path | Answers
    _Folder = str | Path | None
    _Truth = Truth | LiveTruth
    _Truths = Mapping[str, str | Path]
    M = TypeVar("M", default=dict[str, Any], covariant=True)
else:
    from typing import TypeVar

    M = TypeVar("M", covariant=True)


@dataclass(frozen=True, kw_only=True)
class Evaluation(Generic[M]):
    """An evaluation folder. summary: summary.json; undefined numbers are None.

    M: what `metrics` is; a checker knows it where the task was named.
    """

    folder: Place
    summary: Summary

    @overload
    @classmethod
    def open(cls, folder: str | Path, *, task: NumberTask) -> Evaluation[Numbers]: ...
    @overload
    @classmethod
    def open(cls, folder: str | Path, *, task: PolicyTask) -> Evaluation[NumbersByPolicy]: ...
    @overload
    @classmethod
    def open(cls, folder: str | Path, *, task: str | None = ...) -> Evaluation: ...
    @classmethod
    def open(cls, folder: str | Path, *, task: str | None = None) -> Evaluation[Any]:
        """Open an existing evaluation. task: which it must be of, None for any.

        EvaluationFolderError for any other folder, UsageError for another task.
        """
        check_argument("folder", folder)
        place = parse_place(folder)
        with read_from(place) as here:
            summary = read_summary(here)
        _refuse_other("evaluation", place, summary.task, task)
        return cls(folder=place, summary=summary)

    @property
    def task(self) -> str:
        """The task that was evaluated."""
        return self.summary.task

    @property
    def metrics(self) -> M:
        """Metric values as fractions; for depth a dict by hole policy."""
        metrics: dict[str, Any] = {}
        for name, policy, value, _ in self.summary.metric_values():
            if find_family(self.task).by_policy:
                metrics.setdefault(name, {})[policy] = value
            else:
                metrics[name] = value
        return cast("M", metrics)

    @property
    def coverage(self) -> Coverage:
        """The denominators: images attempted, scored, with truth, and by status."""
        return self.summary.coverage

    @property
    def table(self) -> list[dict[str, str | int | float | None]]:
        """One row of plain values per metric: `pandas.DataFrame(evaluation.table)`.

        low, high: the 95 % bootstrap interval, or None.
        """
        rows: list[dict[str, str | int | float | None]] = []
        for name, policy, value, interval in self.summary.metric_values():
            rows.append(
                {
                    "task": self.task,
                    "metric": name,
                    "policy": policy,
                    "value": value,
                    "low": interval.low if interval else None,
                    "high": interval.high if interval else None,
                    "attempted": self.coverage.attempted,
                    "scored": self.coverage.scored,
                }
            )
        return rows

    def per_image(self) -> list[dict[str, Any]]:
        """The rows of per_image.jsonl, by image id."""
        with read_from(self.folder) as here:
            return [as_json(row) for row in read_image_rows(here, self.summary)]

    def to_dict(self) -> dict[str, Any]:
        """The document that `legoworld evaluate --json` prints."""
        return {"evaluation": str(self.folder), "summary": as_json(self.summary)}

    def _repr_html_(self) -> str:
        """What a notebook shows: the main metrics with their intervals."""
        from legoworld.report.notebook import evaluation_html

        return evaluation_html(self.summary)


class EvaluationOptions(TypedDict, total=False):
    """The keyword arguments of `evaluate` beside the ground truth."""

    evaluator: EvaluatorKind | None
    camera_model: Literal["none", "dataset"] | None
    reference_sampling: str | None
    diagnostics: bool
    draws: int | None
    seed: int
    workers: int | None
    engine: EngineName
    overwrite: bool
    listener: Listener


_Options = EvaluationOptions


@overload
def evaluate(
    run: _Run, output: _Folder = ..., *, truth: _Truth, task: NumberTask, **given: Unpack[_Options]
) -> Evaluation[Numbers]: ...
@overload
def evaluate(
    run: _Run, output: _Folder = ..., *, truth: _Truth, task: PolicyTask, **given: Unpack[_Options]
) -> Evaluation[NumbersByPolicy]: ...
@overload
def evaluate(
    run: _Run,
    output: _Folder = ...,
    *,
    truth: _Truth,
    task: str | None = ...,
    **given: Unpack[_Options],
) -> Evaluation: ...
@overload
def evaluate(
    run: str | Path, output: str | Path, *, truth: _Truths, **given: Unpack[_Options]
) -> ByTask[Evaluation]: ...
@partial(check_arguments, but=("run", "output", "truth"))
def evaluate(
    run: _Run,
    output: _Folder = None,
    *,
    truth: _Truth | _Truths,
    task: str | None = None,
    evaluator: EvaluatorKind | None = None,
    camera_model: Literal["none", "dataset"] | None = None,
    reference_sampling: str | None = None,
    diagnostics: bool = True,
    draws: int | None = None,
    seed: int = 0,
    workers: int | None = None,
    engine: EngineName = "local",
    overwrite: bool = False,
    listener: Listener = SILENT,
) -> Evaluation | ByTask[Evaluation]:
    """Score a run against ground truth and write the evaluation folder, which holds ground truth.

    run, output: folders or their URLs. truth: the dataset's own annotations, COCO or LVIS JSON,
    ETH3D's folder, or a bench's DATASET/private; or a mapping of these by task, for the folder of
    the runs of several tasks: run/<task> is then evaluated into output/<task>.

    Or run: answers in memory, and truth, as `score` takes them. They are kept as a run below
    output, beside output/evaluation; without an output all of it is deleted with the `Evaluation`.

    task: which the run must be of, None for any. evaluator:
    "official" (pycocotools, lvis) or "fast" (hotcoco); None selects the official one where it is
    installed. camera_model: depth only; "dataset" warps a scene's pinhole depth through the
    dataset's camera. reference_sampling: bench only, "raster", "all" or "random:SEED"; diagnostics:
    bench only, whether the numbers beside R are computed. draws, seed: number of tie orders and
    bootstrap samples, None for 2000 (bench: 10,000), and their RNG seed. workers, engine: where the
    work runs; they change no byte of the result. overwrite: replace an existing evaluation in the
    folder.

    Raises a LegoWorldError before anything is written: UsageError, TruthInvalidError,
    PredictionsInvalidError, RunUnusableError and others. Of several tasks all are tried, and then
    the first error is raised.
    """
    request = _Request(
        draws=draws,
        seed=seed,
        overwrite=overwrite,
        pool=WorkerPool(engine=engine, workers=workers or engine_cores(engine)),
        listener=listener,
    )
    given: dict[str, Any] = {
        "evaluator": evaluator,
        "camera_model": camera_model,
        "reference_sampling": reference_sampling,
        "diagnostics": None if diagnostics else False,
    }
    if not isinstance(run, str | Path):
        if output is not None:
            check_argument("output", output)
        return request.evaluate_answers(run, cast("_Truth", truth), output, given, task)
    for argument, value in (("run", run), ("output", output), ("truth", truth)):
        check_argument(argument, value)
    source, top = parse_place(run), parse_place(cast("str | Path", output))
    if not isinstance(truth, Mapping):
        return request.evaluate(source, top, Path(cast("str | Path", truth)), given, task)
    truths = cast("_Truths", truth)
    refuse_result_at(top, EVIDENCE, "the evaluations of several tasks")
    by_task = options_by_task(list(truths), **given)
    found: dict[str, Evaluation] = {}
    errors: list[LegoWorldError] = []
    for name, own in truths.items():
        places = task_folder(source, name), task_folder(top, name)
        try:
            found[name] = request.evaluate(*places, Path(own), by_task[name], name)
        except LegoWorldError as error:
            if errors:
                listener.warn(f"{name} was not evaluated: {error}")
            errors.append(error)
    if errors:
        if found:
            listener.warn(f"evaluated: {', '.join(found)} -> {top}")
        raise errors[0]
    return ByTask(folder=top, results=found)


@dataclass(frozen=True, kw_only=True)
class _Request:
    """What the evaluations of one call share."""

    draws: int | None
    seed: int
    overwrite: bool
    pool: WorkerPool
    listener: Listener

    def evaluate_answers(
        self,
        answers: Answers,
        truth: _Truth,
        output: _Folder,
        given: Mapping[str, Any],
        task: str | None,
    ) -> Evaluation:
        """Keep answers in memory as a run, and evaluate it."""
        from legoworld.api.kept_answers import EVALUATION, keep_answers, named_folder
        from legoworld.api.scoring import given_answers

        asked = given_answers(answers, truth, task=task, image_id=None)
        folder, name, delete = named_folder(output)
        try:
            kept = keep_answers(asked, folder, name=name, overwrite=self.overwrite)
            made = self.evaluate(kept.run, folder / EVALUATION, kept.truth, given)
        except BaseException:
            delete()
            raise
        weakref.finalize(made, delete)
        return made

    def evaluate(
        self,
        source: Place,
        written: Place,
        truth: Path,
        given: Mapping[str, Any],
        task: str | None = None,
    ) -> Evaluation:
        """Evaluate one run. task: which it must be of, None for any."""
        origins = Origins(
            run_url=source if isinstance(source, str) else None,
            output_url=written if isinstance(written, str) else None,
        )
        listener = self.listener
        with read_from(source) as here, written_whole(written, last=EVIDENCE) as folder:
            run = read_run(here)
            _refuse_other("run", source, run.task, task)
            listener.total(len(run.images))
            summary = load_evaluation_family(run.task).evaluate(
                EvaluationRequest(
                    run=run,
                    truth=truth,
                    output=folder,
                    draws=self.draws or find_family(run.task).draws,
                    seed=self.seed,
                    options=options_by_task([run.task], **given)[run.task],
                    overwrite=self.overwrite,
                    progress=listener.scored,
                    notice=listener.notice,
                    warn=listener.warn,
                    pool=self.pool,
                    origins=origins,
                )
            )
        return Evaluation(folder=written, summary=summary)


def _refuse_other(what: str, place: Place, task: str, expected: str | None) -> None:
    if expected is not None and task != require_task(expected).name:
        name = PurePosixPath(str(place)).name
        raise UsageError(f"{name}/ holds another {what}", found=task, expected=expected)
