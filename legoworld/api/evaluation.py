"""`evaluate`: score a run against private ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from legoworld.api.arguments import checked
from legoworld.api.folders import place_of, read_from, written_whole
from legoworld.api.listening import SILENT, Listener
from legoworld.errors import UsageError
from legoworld.evaluation.detection.evaluators import EvaluatorKind
from legoworld.evaluation.opening import Origins
from legoworld.evaluation.run import read_run
from legoworld.records.base import as_json
from legoworld.records.evaluation_kinds import TaskSummary
from legoworld.records.evaluation_summary import (
    Coverage,
    DepthSummary,
    Interval,
    Means,
    Values,
)
from legoworld.records.folders.evaluation_reading import EVIDENCE, read_image_rows, read_summary
from legoworld.records.reconstruction_summary import ReconstructionSummary
from legoworld.remote import Place
from legoworld.workers.engines import EngineName, engine_cores
from legoworld.workers.tasks import WorkerPool


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """An evaluation folder. summary: summary.json; undefined numbers are None."""

    folder: Place
    summary: TaskSummary

    @classmethod
    @checked
    def open(cls, folder: str | Path) -> Evaluation:
        """Open an existing evaluation. EvaluationFolderError for any other folder."""
        place = place_of(folder)
        with read_from(place) as here:
            return cls(folder=place, summary=read_summary(here))

    @property
    def task(self) -> str:
        """The task that was evaluated."""
        return self.summary.task

    @property
    def metrics(self) -> Values | Means:
        """Metric values as fractions; for depth a dict by hole policy."""
        if isinstance(self.summary, ReconstructionSummary):
            return {name: mean.value for name, mean in self.summary.metrics.items()}
        return self.summary.metrics

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
        for name, policy, value, interval in self._values():
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

    def _values(self) -> Iterator[tuple[str, str | None, float | None, Interval | None]]:
        summary = self.summary
        if isinstance(summary, DepthSummary):
            for name, by_policy in summary.metrics.items():
                for policy, value in by_policy.items():
                    yield name, policy, value, summary.intervals[name][policy]
        elif isinstance(summary, ReconstructionSummary):
            for name, mean in summary.metrics.items():
                yield name, mean.over, mean.value, mean.interval
        else:
            for name, value in summary.metrics.items():
                yield name, None, value, summary.intervals.get(name)


@checked
def evaluate(
    run: str | Path,
    output: str | Path,
    *,
    truth: str | Path,
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
) -> Evaluation:
    """Score a run against ground truth and write the evaluation folder, which holds ground truth.

    run, output: folders or their URLs. truth: the dataset's own annotations, COCO or LVIS JSON,
    ETH3D's folder, or a bench's DATASET/private. evaluator: "official" (pycocotools, lvis) or
    "fast" (hotcoco); None selects the official one where it is installed. camera_model: depth only;
    "dataset" warps a scene's pinhole depth through the dataset's camera. reference_sampling: bench
    only, "raster", "all" or "random:SEED"; diagnostics: bench only, whether the numbers beside R
    are computed. draws, seed: number of tie orders and bootstrap samples, None for 2000 (bench:
    10,000), and their RNG seed. workers, engine: where the work runs; they change no byte of the
    result. overwrite: replace an existing evaluation in the folder.

    Raises a LegoWorldError before anything is written: UsageError, TruthInvalidError,
    PredictionsInvalidError, RunUnusableError and others.
    """
    source, written = place_of(run), place_of(output)
    pool = WorkerPool(engine=engine, workers=workers or engine_cores(engine))
    origins = Origins(
        run_url=source if isinstance(source, str) else None,
        output_url=written if isinstance(written, str) else None,
    )
    with read_from(source) as here, written_whole(written, last=EVIDENCE) as folder:
        run_read = read_run(here)
        listener.total(len(run_read.images))
        _refuse_others_options(
            run_read.task, evaluator=evaluator, camera_model=camera_model,
            reference_sampling=reference_sampling, diagnostics=diagnostics,
        )  # fmt: skip
        draws = draws or (10_000 if run_read.task == "bench" else 2000)
        summary: TaskSummary
        if run_read.task == "bench":
            from legoworld.evaluation.reconstruction.choices import Choices
            from legoworld.evaluation.reconstruction.evaluate import evaluate_bench

            summary = evaluate_bench(
                here,
                Path(truth),
                folder,
                choices=Choices(sampling=reference_sampling or "raster", diagnostics=diagnostics),
                draws=draws,
                seed=seed,
                overwrite=overwrite,
                progress=listener.scored,
                pool=pool,
                origins=origins,
            )
        elif run_read.task == "eth3d":
            from legoworld.evaluation.depth.evaluate import evaluate_depth

            summary = evaluate_depth(
                here,
                Path(truth),
                folder,
                camera_model=camera_model or "none",
                draws=draws,
                seed=seed,
                overwrite=overwrite,
                progress=listener.scored,
                pool=pool,
                origins=origins,
            )
        else:
            from legoworld.evaluation.detection.evaluate import evaluate_detections

            summary = evaluate_detections(
                here,
                Path(truth),
                folder,
                evaluator=evaluator,
                draws=draws,
                seed=seed,
                overwrite=overwrite,
                notice=listener.notice,
                warn=listener.warn,
                pool=pool,
                origins=origins,
            ).summary
    return Evaluation(folder=written, summary=summary)


def _refuse_others_options(
    task: str,
    *,
    evaluator: EvaluatorKind | None,
    camera_model: str | None,
    reference_sampling: str | None,
    diagnostics: bool,
) -> None:
    """UsageError for an option of another task."""
    if evaluator is not None and task in ("eth3d", "bench"):
        raise UsageError("--evaluator is for boxes and masks: depth and bench have one evaluator")
    if camera_model is not None and task != "eth3d":
        raise UsageError("--camera-model is for depth: nothing else is warped")
    if task != "bench" and (reference_sampling is not None or not diagnostics):
        raise UsageError("--reference-sampling and --no-diagnostics are for a bench")
