"""`legoworld evaluate` of a run with an array for each image: writes an evaluation folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from legoworld.cards import load_card
from legoworld.errors import LegoWorldError
from legoworld.evaluation.bootstrap import check_draws
from legoworld.evaluation.family import EvaluationRequest
from legoworld.evaluation.pixels.family import (
    Options,
    PixelFamily,
    SecondReading,
    Settings,
    TruthFile,
)
from legoworld.evaluation.pixels.image_tasks import ImageTask, image_tasks, scored_images
from legoworld.evaluation.pixels.predictions import PixelRun, read_pixel_run
from legoworld.evaluation.pixels.summary import summarise
from legoworld.evaluation.prepare_inputs import prepared_inputs
from legoworld.evaluation.run import run_view
from legoworld.files import names_a_file
from legoworld.records.folders.evaluation_folder import (
    Evaluation,
    evidence_of,
    write_evaluation,
)
from legoworld.records.folders.read_run import ROWS, RUN
from legoworld.records.pixels import PixelRow


def evaluate_pixels(family: PixelFamily, request: EvaluationRequest) -> Any:
    """Score a run and write the evaluation folder; return its summary.

    Each worker of the pool has one image in memory. Raises before scoring if run, ground truth,
    options and output do not fit together; an error of one prediction is recorded in that image's
    row.
    """
    options = {**family.options, **request.options}
    settings = Settings(options=options, draws=request.draws, seed=request.seed)
    truth = request.truth.absolute()
    run = read_pixel_run(request.run.absolute(), family)
    protocol = family.protocol(load_card(run.run.task))
    files = family.find_truth(truth, [image.image for image in run.images])
    check_draws(settings.draws, settings.seed)
    family.check(run, files, options)
    configuration = family.records.configuration(
        task=protocol.card.task,
        card_version=protocol.card.version,
        card_sha256=protocol.card.sha256,
        draws=settings.draws,
        seed=settings.seed,
        **options,
    )
    inputs = prepared_inputs(
        request.output,
        _inputs(run, truth / family.declaration, files),
        configuration,
        run=run.run.folder,
        origins=request.origins,
        overwrite=request.overwrite,
    )
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
        evidence=evidence_of(family.records.evidence, summary, configuration),
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
