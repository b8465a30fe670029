"""Normals as a family of evaluations: what its arrays are, and how an image is measured."""

from __future__ import annotations

from functools import partial
from typing import Any, Final, cast

import numpy as np
from msgspec.structs import asdict, replace
from numpy.typing import NDArray

from legoworld.evaluation.family import EvaluationFamily
from legoworld.evaluation.normals.angles import (
    angular_errors,
    bin_errors,
    image_metrics,
    sum_errors,
)
from legoworld.evaluation.normals.arrays import (
    DECLARATION,
    ERRORS,
    SIGNS,
    TOWARDS,
    NormalsArray,
    NormalsPredictionError,
    find_truth,
    load_truth,
    read_prediction,
    unit_vectors,
    valid_normals,
)
from legoworld.evaluation.normals.pooling import MEDIAN, own_fields
from legoworld.evaluation.normals.protocol import ERROR_90, HOLE_DEG, METRICS, normals_protocol
from legoworld.evaluation.normals.text import normals_metrics, normals_notes, short_normals
from legoworld.evaluation.pixels.evaluate import evaluate_pixels
from legoworld.evaluation.pixels.family import (
    ImageResult,
    Measuring,
    PixelFamily,
    PixelProtocol,
    PixelRecords,
    PixelTruth,
)
from legoworld.evaluation.pixels.live import live_pixels
from legoworld.evaluation.pixels.resampling import Sample, sampler
from legoworld.evaluation.pixels.rows import too_few, with_holes
from legoworld.evaluation.pixels.verification import verify_pixels
from legoworld.evaluation.pixels.view import encode_array, shown_pixels
from legoworld.readouts.normals import NORMALS_FILE
from legoworld.records.evaluation_view import NormalsView
from legoworld.records.normals import (
    AllAttempted,
    NormalsChoices,
    NormalsConfiguration,
    NormalsEvidence,
    NormalsRow,
    NormalsSummary,
    ScoredNormalsRow,
)
from legoworld.tasks.shipped import NORMALS

#: Mean error from which the array turned around has one below 45 degrees.
_TURNED_DEG: Final = 180.0 - 45.0


def measure_normals(image: Measuring) -> ImageResult:
    """Score one image. NormalsPredictionError where the prediction's sign cannot be as stated.

    bins, where they are asked for: the view's place has the errors in these alone.
    """
    row: NormalsRow = replace(image.row, sign=image.prediction.sign)
    sample = sampler(image.prediction, image.truth.size_wh)
    errors = angular_errors(image.truth.values, sample, row.n_valid)
    if "bins" in image.options:
        there = np.isin(bin_errors(errors), cast("list[int]", image.options["bins"]))
        return ImageResult(row=row, view=errors[there])
    row = with_holes(row, len(errors))
    if len(errors) < image.protocol.min_valid_px:
        return too_few(row, len(errors), image.protocol.min_valid_px)
    sums = sum_errors(errors)
    mean = sums.sum_deg / sums.n
    if mean > _TURNED_DEG:
        (other,) = set(SIGNS) - {image.prediction.sign}
        raise NormalsPredictionError(
            "the normals point the other way than their sign says",
            found=f"a mean error of {mean:.1f} degrees, and of {180.0 - mean:.1f} turned around",
            expected=f"normals {image.prediction.sign.replace('_', ' ')}",
            next_step=f"state sign = {other} if the prediction's is wrong, or correct the truth's",
        )
    scored = ScoredNormalsRow(
        **asdict(replace(row, status="ok")),
        errors=sums,
        metrics=image_metrics(errors, sums, row.n_valid - sums.n),
    )
    return ImageResult(row=scored, view=_view(image.truth, sample))


def _view(truth: PixelTruth, sample: Sample) -> NormalsView:
    """A small view of the truth and of the prediction."""
    shown = shown_pixels(truth.values, valid_normals)
    true, sampled = truth.values[shown.rows, shown.cols], sample(shown.rows, shown.cols)
    return NormalsView(
        size_wh=shown.size_wh,
        image_wh=truth.size_wh,
        truth=encode_array(unit_vectors(true), valid_normals(true), NORMALS_FILE.hole),
        predicted=encode_array(unit_vectors(sampled.values), sampled.predicted, NORMALS_FILE.hole),
    )


def _missing_mean_deg(_protocol: PixelProtocol) -> float:
    return HOLE_DEG


def _make_truth(values: NDArray[Any]) -> PixelTruth:
    return PixelTruth(values=values, counts={})


def _array(values: NDArray[Any]) -> NormalsArray:
    return NormalsArray(values=values, sign=TOWARDS)


PIXELS: Final = PixelFamily(
    family=NORMALS,
    noun="normals",
    stored=NORMALS_FILE,
    row=NormalsRow,
    errors=ERRORS,
    metrics=METRICS,
    primary=ERROR_90,
    missing=_missing_mean_deg,
    declaration=DECLARATION,
    protocol=normals_protocol,
    valid=valid_normals,
    find_truth=find_truth,
    load_truth=load_truth,
    make_truth=_make_truth,
    read=read_prediction,
    array=_array,
    measure=measure_normals,
    records=PixelRecords(
        summary=NormalsSummary,
        choices=NormalsChoices,
        attempted=AllAttempted,
        configuration=NormalsConfiguration,
        evidence=NormalsEvidence,
    ),
    own=own_fields,
    again=MEDIAN,
)

EVALUATION: Final = EvaluationFamily(
    evaluate=partial(evaluate_pixels, PIXELS),
    verify=partial(verify_pixels, PIXELS),
    short=short_normals,
    metrics=normals_metrics,
    notes=normals_notes,
    truth_is_file=False,
    live=live_pixels(PIXELS, {}),
)
