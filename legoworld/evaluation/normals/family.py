"""Normals as a family of evaluations: what its arrays are, and how they are measured."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from numpy.typing import NDArray

from legoworld.evaluation.family import EvaluationFamily
from legoworld.evaluation.normals.arrays import (
    DECLARATION,
    TOWARDS,
    NormalsArray,
    read_prediction,
    valid_normals,
)
from legoworld.evaluation.normals.errors import ERRORS
from legoworld.evaluation.normals.pooling import MEDIAN, own_fields
from legoworld.evaluation.normals.protocol import (
    ERROR_90,
    HOLE_DEG,
    METRICS,
    normals_protocol,
)
from legoworld.evaluation.normals.rows import measure_normals
from legoworld.evaluation.normals.text import normals_metrics, normals_notes, short_normals
from legoworld.evaluation.normals.truth import find_truth, load_truth
from legoworld.evaluation.pixels.evaluate import evaluate_pixels
from legoworld.evaluation.pixels.family import PixelFamily, PixelRecords, PixelTruth
from legoworld.evaluation.pixels.live import live_pixels
from legoworld.evaluation.pixels.protocol import PixelProtocol
from legoworld.evaluation.pixels.verification import verify_pixels
from legoworld.readouts.normals import NORMALS_FILE
from legoworld.records.normals import (
    AllAttempted,
    NormalsChoices,
    NormalsConfiguration,
    NormalsEvidence,
    NormalsRow,
    NormalsSummary,
)
from legoworld.tasks.shipped import NORMALS


def _given(_protocol: PixelProtocol) -> float:
    return HOLE_DEG


def _truth_of(values: NDArray[Any]) -> PixelTruth:
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
    missing=_given,
    declaration=DECLARATION,
    protocol=normals_protocol,
    valid=valid_normals,
    find_truth=find_truth,
    load_truth=load_truth,
    truth_of=_truth_of,
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
