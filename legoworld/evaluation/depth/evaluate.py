"""`legoworld evaluate` of a depth run: writes an evaluation folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from legoworld.cards import load_card
from legoworld.errors import UsageError
from legoworld.evaluation.bootstrap import check_draws
from legoworld.evaluation.depth.declaration import DECLARATION
from legoworld.evaluation.depth.errors import DepthTruthError
from legoworld.evaluation.depth.image_tasks import image_tasks, scored_images
from legoworld.evaluation.depth.predictions import DepthRun, read_depth_run
from legoworld.evaluation.depth.protocol import CAMERA_MODELS, DepthProtocol, depth_protocol
from legoworld.evaluation.depth.summary import Settings, summarise
from legoworld.evaluation.depth.truth import TruthFile, find_truth
from legoworld.evaluation.opening import HERE, Origins, prepared_inputs
from legoworld.evaluation.run import run_view
from legoworld.files import names_a_file
from legoworld.records.depth import DepthConfiguration, DepthEvidence
from legoworld.records.evaluation_rows import DepthRow
from legoworld.records.evaluation_summary import DepthSummary
from legoworld.records.folders.evaluation_folder import (
    Evaluation,
    installed_versions,
    write_evaluation,
)
from legoworld.records.folders.run_reading import ROWS, RUN
from legoworld.workers.tasks import IN_PROCESS, WorkerPool


def evaluate_depth(
    run: Path,
    truth: Path,
    output: Path,
    *,
    camera_model: str = "none",
    draws: int = 2000,
    seed: int = 0,
    overwrite: bool = False,
    progress: Callable[[DepthRow], None] | None = None,
    pool: WorkerPool = IN_PROCESS,
    origins: Origins = HERE,
) -> DepthSummary:
    """Score a depth run and write the evaluation folder; return its summary.

    truth: ETH3D's folder, or a folder of arrays named like the photos. camera_model "dataset" reads
    a scene's pinhole depth through the dataset's distorted camera. pool: processes the images; any
    pool gives the same bytes; each worker has one image in memory. progress: called with each row
    in image order. Raises before scoring if run, ground truth, options and output do not fit
    together; an error of one prediction is recorded in that image's row.
    """
    settings = Settings(camera_model=camera_model, draws=draws, seed=seed)
    run, truth = run.absolute(), truth.absolute()
    depth_run = read_depth_run(run)
    protocol = depth_protocol(load_card(depth_run.run.task))
    files = find_truth(truth, [image.image for image in depth_run.images])
    _check(depth_run, files, settings)
    configuration = _configuration(protocol, settings)
    read = _inputs(depth_run, truth, files)
    inputs = prepared_inputs(
        output, read, configuration, run=run, origins=origins, overwrite=overwrite
    )
    rows: list[DepthRow] = []
    views: dict[str, Any] = {"run.json": run_view(depth_run.run)}
    tasks = image_tasks(depth_run, files, warped=camera_model == "dataset")
    for task, result in zip(tasks, scored_images(tasks, pool), strict=True):
        rows.append(result.row)
        if result.view is not None:
            views[f"{task.image.image.image_id}.json"] = result.view
        if progress is not None:
            progress(result.row)
    summary = summarise(
        rows,
        kind=depth_run.kind,
        partial=depth_run.run.partial,
        protocol=protocol,
        settings=settings,
    )
    evaluation = Evaluation(
        summary=summary,
        evidence=DepthEvidence(
            versions=installed_versions(),
            inputs=(),
            files={},
            task=summary.task,
            evaluator=summary.evaluator,
            coverage=summary.coverage,
            configuration=configuration,
            protocol=summary.protocol,
            metrics=summary.metrics,
        ),
        inputs=inputs,
        per_image=rows,
        view=views,
    )
    write_evaluation(output, evaluation, overwrite=overwrite)
    return summary


def _check(run: DepthRun, files: Sequence[TruthFile], settings: Settings) -> None:
    check_draws(settings.draws, settings.seed)
    if settings.camera_model not in CAMERA_MODELS:
        raise UsageError(
            "unknown camera model",
            found=repr(settings.camera_model),
            expected=" or ".join(CAMERA_MODELS),
        )
    if settings.camera_model == "none":
        return
    if run.kind != "scene":
        raise UsageError(
            "only a scene's depth can be warped to the dataset's camera",
            found=f"a run of kind {run.kind!r}, which saw the distorted photo itself",
            expected="a run of `legoworld readout`",
            next_step="score it with --camera-model none",
        )
    without = [file.path.name for file in files if file.camera is None]
    if without:
        raise DepthTruthError(
            "--camera-model dataset needs the camera of every photo",
            found=f"{len(without)} of {len(files)} without one, such as {without[0]}",
            expected="<scene>/dslr_calibration_jpg/cameras.txt and images.txt",
        )


def _configuration(protocol: DepthProtocol, settings: Settings) -> DepthConfiguration:
    return DepthConfiguration(
        task=protocol.card.task,
        card_version=protocol.card.version,
        card_sha256=protocol.card.sha256,
        camera_model=settings.camera_model,
        draws=settings.draws,
        seed=settings.seed,
    )


def _inputs(run: DepthRun, truth: Path, files: Sequence[TruthFile]) -> list[tuple[str, Path]]:
    """Every file the score depends on; one that is shared by images comes once."""
    paths = [("run", run.run.folder / RUN), ("run_rows", run.run.folder / ROWS)]
    paths += [("prediction", image.path) for image in run.images if names_a_file(image.path)]
    paths += [("truth", file.path) for file in files]
    if (truth / DECLARATION).is_file():
        paths.append(("truth_declaration", truth / DECLARATION))
    calibration = sorted({path for file in files for path in file.calibration})
    paths += [("calibration", path) for path in calibration]
    return paths
