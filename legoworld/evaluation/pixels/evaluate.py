"""`legoworld evaluate` of a run with an array for each image, and verification of its folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

from legoworld.cards import load_card
from legoworld.errors import LegoWorldError
from legoworld.evaluation.bootstrap import check_draws
from legoworld.evaluation.checks import Check, find_closest, refuse_unseen
from legoworld.evaluation.evidence import agreement, check_rows, check_summary, spread_evenly
from legoworld.evaluation.family import (
    EvaluationRequest,
    RecordedEvaluation,
    make_configuration,
    prepare_inputs,
)
from legoworld.evaluation.pixels.family import (
    ImageResult,
    Options,
    PixelFamily,
    SecondReading,
    Settings,
    TruthFile,
)
from legoworld.evaluation.pixels.rows import (
    PixelImage,
    PixelRun,
    pixel_run,
    read_pixel_run,
    score_row,
)
from legoworld.evaluation.pixels.summary import summarise
from legoworld.evaluation.run import run_view
from legoworld.files import names_a_file
from legoworld.records.folders.evaluation_folder import Evaluation, make_evidence, write_evaluation
from legoworld.records.folders.read_run import ROWS, RUN
from legoworld.records.pixels import PixelRow
from legoworld.records.run_rows import RunImage
from legoworld.workers.tasks import WorkerPool, map_items

#: Bytes of ground truth that are scored in the time that other processes take to start.
_FEW_BYTES: Final = 16 << 20


@dataclass(frozen=True, kw_only=True)
class ImageTask:
    """One image to score. task: its name; sizes_bytes: of its files as the command sees them."""

    family: PixelFamily
    task: str
    image: PixelImage
    file: TruthFile
    options: Options
    sizes_bytes: dict[Path, int]


def image_tasks(
    run: PixelRun, files: Sequence[TruthFile], family: PixelFamily, options: Options
) -> list[ImageTask]:
    """The task of each image of a run."""
    return [
        ImageTask(
            family=family,
            task=run.run.task,
            image=image,
            file=file,
            options=options,
            sizes_bytes={p: p.stat().st_size for p in (image.path, file.path) if p.is_file()},
        )
        for image, file in zip(run.images, files, strict=True)
    ]


def scored_images(tasks: Sequence[ImageTask], pool: WorkerPool) -> Iterator[ImageResult]:
    """The result of every image, in the order of the tasks."""
    truth_bytes = sum(task.sizes_bytes.get(task.file.path, 0) for task in tasks)
    much = len(tasks) > 1 and truth_bytes > _FEW_BYTES
    return map_items(score_task, tasks, pool.for_work(worth_a_process=much))


def score_task(task: ImageTask) -> ImageResult:
    """Score one image. The family's `unseen` if this machine does not see the command's files.

    Otherwise a file missing on this machine would be mistaken for a missing prediction.
    """
    what = f"the {task.family.noun} files of {task.image.image.file_name}"
    refuse_unseen(task.sizes_bytes, what, task.family.errors.unseen)
    return score_row(task.image, task.file, task.family, task.task, task.options)


def evaluate_pixels(family: PixelFamily, request: EvaluationRequest) -> Any:
    """Score a run and write the evaluation folder; return its summary.

    Each worker of the pool has one image in memory. Raises before scoring if run, ground truth,
    options and output do not fit together; an error of one prediction is recorded in that image's
    row.
    """
    options = {**family.options, **request.options}
    settings = Settings(options=options, draws=request.draws, seed=request.seed)
    truth = request.truth.absolute()
    run = pixel_run(request.run.absolute(), family)
    protocol = family.protocol(load_card(run.run.task))
    files = family.find_truth(truth, [image.image for image in run.images])
    card = protocol.card
    configuration = make_configuration(
        request, card, family.records.configuration, card_version=card.version, **options
    )
    check_draws(request.draws, request.seed)
    family.check(run, files, options)
    inputs = prepare_inputs(request, _inputs(run, truth / family.declaration, files), configuration)
    rows: list[PixelRow] = []
    views: dict[str, Any] = {"run.json": run_view(run.run)}
    tasks = image_tasks(run, files, family, options)
    for task, result in zip(tasks, scored_images(tasks, request.pool), strict=True):
        rows.append(result.row)
        if result.view is not None:
            views[f"{task.image.image.image_id}.json"] = result.view
        request.progress(result.row)
    if family.again is not None:
        more = _read_again(family.again, tasks, rows, request)
        settings = replace(settings, options={**options, **more})
    summary = summarise(
        family, rows, kind=run.kind, partial=run.run.partial, protocol=protocol, settings=settings
    )
    evaluation = Evaluation(
        summary=summary,
        evidence=make_evidence(family.records.evidence, summary, configuration),
        inputs=inputs,
        per_image=rows,
        view=views,
    )
    write_evaluation(request.output, evaluation, overwrite=request.overwrite)
    return summary


def _read_again(
    again: SecondReading,
    tasks: Sequence[ImageTask],
    rows: Sequence[PixelRow],
    request: EvaluationRequest,
) -> Options:
    """What a second reading of the scored images says of the summary."""
    scored = [row for row in rows if row.has_score]
    asked = again.question(scored)
    taken = [
        replace(task, options={**task.options, **asked})
        for task, row in zip(tasks, rows, strict=True)
        if row.has_score
    ]
    results = list(scored_images(taken, request.pool))
    if any(result.view is None for result in results):
        raise LegoWorldError("a file of the run or of the ground truth changed while it was scored")
    return again.conclude(scored, [result.view for result in results])


def _inputs(run: PixelRun, declaration: Path, files: Sequence[TruthFile]) -> list[tuple[str, Path]]:
    """Every file the score depends on; one that is shared by images comes once."""
    paths = [("run", run.run.folder / RUN), ("run_rows", run.run.folder / ROWS)]
    paths += [("prediction", image.path) for image in run.images if names_a_file(image.path)]
    paths += [("truth", file.path) for file in files]
    if declaration.is_file():
        paths.append(("truth_declaration", declaration))
    calibration = sorted({path for file in files for path in file.calibration})
    paths += [("calibration", path) for path in calibration]
    return paths


def verify_pixels(family: PixelFamily, recorded: RecordedEvaluation) -> Iterator[Check]:
    """Compare the summary with that recomputed from the rows, and rows with those of the arrays."""
    summary: Any = recorded.summary
    options: Options = {name: getattr(summary.protocol, name) for name in family.options}
    recalled = family.again.recall(summary) if family.again else {}
    bootstrap = summary.bootstrap
    again = summarise(
        family,
        cast("Sequence[PixelRow]", recorded.rows),
        kind=str(summary.kind),
        partial=summary.partial,
        protocol=family.protocol(load_card(summary.task)),
        settings=Settings(
            options={**options, **recalled}, draws=bootstrap.draws, seed=bootstrap.seed
        ),
    )
    yield from check_summary(recorded, again)
    evidence: Any = recorded.evidence
    yield agreement("metrics in the evidence", evidence.metrics, summary.metrics)
    if recorded.inputs_hold:
        yield from _rescore_rows(family, recorded, options)


def _rescore_rows(
    family: PixelFamily, recorded: RecordedEvaluation, options: Options
) -> Iterator[Check]:
    """Re-score up to `SCORED_AGAIN` images from the available run and ground truth."""
    run = read_pixel_run(recorded.input("run").parent, family)
    files = _truth_files(recorded.input("truth"), [image.image for image in run.images], family)
    some = spread_evenly(list(zip(run.images, files, strict=True)))
    results = (score_row(image, file, family, run.run.task, options) for image, file in some)
    yield from check_rows(recorded, (result.row for result in results))


def _truth_files(
    first: Path, images: Sequence[RunImage], family: PixelFamily
) -> tuple[TruthFile, ...]:
    """The ground truth of every image, from the closest common parent folder."""

    def find_files(folder: Path) -> tuple[TruthFile, ...] | None:
        files = family.find_truth(folder, images)
        return files if files[0].path == first else None

    return find_closest(first.parents, find_files)
