"""`evaluate`: score a run against private ground truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from legoworld.api.arguments import checked
from legoworld.api.family_options import own_options
from legoworld.api.folders import place_of, read_from, written_whole
from legoworld.api.listening import SILENT, Listener
from legoworld.evaluation.detection.evaluators import EvaluatorKind
from legoworld.evaluation.family import EvaluationRequest, evaluation_of
from legoworld.evaluation.opening import Origins
from legoworld.evaluation.run import read_run
from legoworld.records.base import as_json
from legoworld.records.evaluation_summary import Coverage, Summary
from legoworld.records.folders.evaluation_reading import EVIDENCE, read_image_rows, read_summary
from legoworld.remote import Place
from legoworld.tasks.registry import family_of
from legoworld.workers.engines import EngineName, engine_cores
from legoworld.workers.tasks import WorkerPool


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """An evaluation folder. summary: summary.json; undefined numbers are None."""

    folder: Place
    summary: Summary

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
    def metrics(self) -> dict[str, Any]:
        """Metric values as fractions; for depth a dict by hole policy."""
        found: dict[str, Any] = {}
        for name, policy, value, _ in self.summary.metric_values():
            if family_of(self.task).by_policy:
                found.setdefault(name, {})[policy] = value
            else:
                found[name] = value
        return found

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
        options = own_options(
            run_read.task, evaluator=evaluator, camera_model=camera_model,
            reference_sampling=reference_sampling, diagnostics=None if diagnostics else False,
        )  # fmt: skip
        summary = evaluation_of(run_read.task).evaluate(
            EvaluationRequest(
                run=here,
                truth=Path(truth),
                output=folder,
                draws=draws or family_of(run_read.task).draws,
                seed=seed,
                options=options,
                overwrite=overwrite,
                progress=listener.scored,
                notice=listener.notice,
                warn=listener.warn,
                pool=pool,
                origins=origins,
            )
        )
    return Evaluation(folder=written, summary=summary)
