"""Normals as a family of evaluations: what its arrays are, and how they are measured."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, Final

from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.evaluation.family import EvaluationFamily, EvaluationRequest
from legoworld.evaluation.normals.arrays import (
    DECLARATION,
    TOWARDS,
    NormalsArray,
    read_prediction,
    valid_normals,
)
from legoworld.evaluation.normals.errors import (
    NormalsMissingError,
    NormalsPredictionError,
    NormalsTruthError,
    NormalsUnseenError,
)
from legoworld.evaluation.normals.protocol import (
    ERROR_90,
    METRICS,
    NormalsProtocol,
    normals_protocol,
)
from legoworld.evaluation.normals.rows import measure_normals
from legoworld.evaluation.normals.summary import summarise
from legoworld.evaluation.normals.text import normals_metrics, normals_notes, short_normals
from legoworld.evaluation.normals.truth import NormalsTruthFile, find_truth, load_truth
from legoworld.evaluation.pixels.evaluate import evaluate_pixels
from legoworld.evaluation.pixels.family import (
    Options,
    PixelErrors,
    PixelFamily,
    PixelTruth,
    Settings,
)
from legoworld.evaluation.pixels.live import live_pixels
from legoworld.evaluation.pixels.predictions import PixelRun
from legoworld.evaluation.pixels.verification import verify_pixels
from legoworld.readouts.normals import NORMALS_FILE
from legoworld.records.folders.evaluation_folder import installed_versions
from legoworld.records.normals import (
    NormalsConfiguration,
    NormalsEvidence,
    NormalsRow,
    NormalsSummary,
)
from legoworld.tasks.shipped import NORMALS


def _configuration(protocol: NormalsProtocol, settings: Settings) -> NormalsConfiguration:
    return NormalsConfiguration(
        task=protocol.card.task,
        card_version=protocol.card.version,
        card_sha256=protocol.card.sha256,
        draws=settings.draws,
        seed=settings.seed,
    )


def _evidence(summary: NormalsSummary, configuration: NormalsConfiguration) -> NormalsEvidence:
    return NormalsEvidence(
        versions=installed_versions(),
        inputs=(),
        files={},
        task=summary.task,
        evaluator=summary.evaluator,
        coverage=summary.coverage,
        configuration=configuration,
        protocol=summary.protocol,
        metrics=summary.metrics,
        pooled=summary.pooled,
    )


def _protocol(task: str) -> NormalsProtocol:
    return normals_protocol(load_card(task))


def _any(_run: PixelRun, _files: Sequence[NormalsTruthFile], _options: Options) -> None:
    """No option has to fit to run and truth."""


def _truth_of(values: NDArray[Any]) -> PixelTruth:
    return PixelTruth(values=values, counts={})


def _array(values: NDArray[Any]) -> NormalsArray:
    return NormalsArray(values=values, sign=TOWARDS)


def _no_options(_summary: NormalsSummary) -> Options:
    return {}


PIXELS: Final = PixelFamily(
    family=NORMALS,
    noun="normals",
    stored=NORMALS_FILE,
    row=NormalsRow,
    errors=PixelErrors(
        truth=NormalsTruthError,
        prediction=NormalsPredictionError,
        missing=NormalsMissingError,
        unseen=NormalsUnseenError,
    ),
    metrics=METRICS,
    primary=ERROR_90,
    declaration=DECLARATION,
    protocol=_protocol,
    valid=valid_normals,
    group=str,  # the bootstrap draws images
    find_truth=find_truth,
    load_truth=load_truth,
    truth_of=_truth_of,
    read=read_prediction,
    array=_array,
    measure=measure_normals,
    check=_any,
    summarise=summarise,
    configuration=_configuration,
    evidence=_evidence,
    options_of=_no_options,
)


def evaluate_normals(request: EvaluationRequest) -> NormalsSummary:
    """Score a run of normals and write the evaluation folder; return its summary.

    truth: a folder of arrays named like the photos.
    """
    summary: NormalsSummary = evaluate_pixels(PIXELS, request, {})
    return summary


EVALUATION: Final = EvaluationFamily(
    evaluate=evaluate_normals,
    verify=partial(verify_pixels, PIXELS),
    short=short_normals,
    metrics=normals_metrics,
    notes=normals_notes,
    truth_is_file=False,
    live=live_pixels(PIXELS, {}),
)
