"""Depth as a family of evaluations: what its arrays are, and how they are measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.errors import UsageError
from legoworld.evaluation.depth.arrays import DepthArray, checked_array
from legoworld.evaluation.depth.declaration import DECLARATION
from legoworld.evaluation.depth.errors import (
    DepthMissingError,
    DepthPredictionError,
    DepthTruthError,
    DepthUnseenError,
)
from legoworld.evaluation.depth.eth3d import parse_scene_name
from legoworld.evaluation.depth.labelled import read_prediction
from legoworld.evaluation.depth.protocol import (
    CAMERA_MODELS,
    METRICS,
    PRIMARY_POLICY,
    DepthProtocol,
    depth_protocol,
)
from legoworld.evaluation.depth.rows import measure_depth
from legoworld.evaluation.depth.scoring import valid_truth
from legoworld.evaluation.depth.summary import summarise
from legoworld.evaluation.depth.text import depth_metrics, depth_notes, short_depth
from legoworld.evaluation.depth.truth import DepthTruthFile, find_truth, load_truth, truth_of
from legoworld.evaluation.family import EvaluationFamily, EvaluationRequest
from legoworld.evaluation.pixels.evaluate import evaluate_pixels
from legoworld.evaluation.pixels.family import Options, PixelErrors, PixelFamily, Settings
from legoworld.evaluation.pixels.live import live_pixels
from legoworld.evaluation.pixels.predictions import PixelRun
from legoworld.evaluation.pixels.verification import verify_pixels
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.depth import DepthConfiguration, DepthEvidence, DepthRow, DepthSummary
from legoworld.records.folders.evaluation_folder import installed_versions
from legoworld.tasks.shipped import DEPTH


def _check(run: PixelRun, files: Sequence[DepthTruthFile], options: Options) -> None:
    camera_model = options["camera_model"]
    if camera_model not in CAMERA_MODELS:
        raise UsageError(
            "unknown camera model",
            found=repr(camera_model),
            expected=" or ".join(CAMERA_MODELS),
        )
    if camera_model == "none":
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
        camera_model=settings.options["camera_model"],
        draws=settings.draws,
        seed=settings.seed,
    )


def _evidence(summary: DepthSummary, configuration: DepthConfiguration) -> DepthEvidence:
    return DepthEvidence(
        versions=installed_versions(),
        inputs=(),
        files={},
        task=summary.task,
        evaluator=summary.evaluator,
        coverage=summary.coverage,
        configuration=configuration,
        protocol=summary.protocol,
        metrics=summary.metrics,
    )


def _array(z_m: NDArray[Any]) -> DepthArray:
    return checked_array(z_m, space="depth", unit="m", intrinsics_px=None, source="the array")


def _protocol(task: str) -> DepthProtocol:
    return depth_protocol(load_card(task))


def _group(file_name: str) -> str:
    return parse_scene_name(file_name) or file_name


def _options_of(summary: DepthSummary) -> Mapping[str, Any]:
    return {"camera_model": summary.protocol.camera_model}


PIXELS: Final = PixelFamily(
    family=DEPTH,
    noun="depth",
    stored=DEPTH_FILE,
    row=DepthRow,
    errors=PixelErrors(
        truth=DepthTruthError,
        prediction=DepthPredictionError,
        missing=DepthMissingError,
        unseen=DepthUnseenError,
    ),
    metrics=METRICS,
    primary=PRIMARY_POLICY,
    declaration=DECLARATION,
    protocol=_protocol,
    valid=valid_truth,
    group=_group,
    find_truth=find_truth,
    load_truth=load_truth,
    truth_of=truth_of,
    read=read_prediction,
    array=_array,
    measure=measure_depth,
    check=_check,
    summarise=summarise,
    configuration=_configuration,
    evidence=_evidence,
    options_of=_options_of,
)


def evaluate_depth(request: EvaluationRequest) -> DepthSummary:
    """Score a depth run and write the evaluation folder; return its summary.

    truth: ETH3D's folder, or a folder of arrays named like the photos. camera_model "dataset" reads
    a scene's pinhole depth through the dataset's distorted camera.
    """
    options = {"camera_model": request.options.get("camera_model", "none")}
    summary: DepthSummary = evaluate_pixels(PIXELS, request, options)
    return summary


EVALUATION: Final = EvaluationFamily(
    evaluate=evaluate_depth,
    verify=partial(verify_pixels, PIXELS),
    short=short_depth,
    metrics=depth_metrics,
    notes=depth_notes,
    truth_is_file=False,
    live=live_pixels(PIXELS, {"camera_model": "none"}),
)
