"""Normals as a family of evaluations: its arrays, how an image is measured, what is printed."""

from __future__ import annotations

from functools import partial
from typing import Any, Final, cast

import numpy as np
from msgspec.structs import asdict, replace
from numpy.typing import NDArray

from legoworld.evaluation.family import EvaluationFamily
from legoworld.evaluation.metrics import (
    MetricPart,
    MetricRow,
    describe_evaluator,
    fraction,
    image_counts,
    metric_parts,
    number_cell,
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
from legoworld.evaluation.normals.protocol import (
    ANGLES,
    ERROR_90,
    FAILS,
    METRICS,
    angular_errors,
    bin_errors,
    image_metrics,
    normals_protocol,
    sum_errors,
)
from legoworld.evaluation.pixels.evaluate import evaluate_pixels, verify_pixels
from legoworld.evaluation.pixels.family import (
    ImageResult,
    Measuring,
    PixelFamily,
    PixelRecords,
    PixelTruth,
)
from legoworld.evaluation.pixels.live import live_pixels
from legoworld.evaluation.pixels.resampling import Sample, encode_array, sampler, shown_pixels
from legoworld.evaluation.pixels.rows import too_few, with_holes
from legoworld.evaluation.pixels.summary import attempted_rows, list_few_unscored, list_unscored
from legoworld.pluralize import plural
from legoworld.readouts.normals import NORMALS_FILE
from legoworld.records.normals import (
    AllAttempted,
    NormalsChoices,
    NormalsConfiguration,
    NormalsEvidence,
    NormalsRow,
    NormalsSummary,
    NormalsView,
    ScoredNormalsRow,
)
from legoworld.tasks.shipped import NORMALS

#: Mean error from which the array turned around has one below 45 degrees.
_TURNED_DEG: Final = 180.0 - 45.0


def short_normals(summary: NormalsSummary) -> str:
    """Pooled numbers under the primary policy with denominators, and the unscored images."""
    pooled = summary.pooled
    angles = [f"{name} {_degrees(pooled[name][ERROR_90])}" for name in ANGLES]
    shares = [f"{name} {fraction(pooled[name][FAILS])}" for name in pooled if name not in ANGLES]
    lines = [
        f"{describe_evaluator(summary)}: {image_counts(summary.coverage)}",
        f"{plural(summary.pooled_px, 'pixel', 'pixels')} pooled: {', '.join([*angles, *shares])}",
    ]
    return "\n".join([*lines, *list_few_unscored(summary)])


def normals_metrics(summary: NormalsSummary) -> list[MetricPart]:
    """The pooled numbers, then the means over images with their intervals."""
    pixels = {True: summary.predicted_px, False: summary.pooled_px}
    pooled = [
        MetricRow(
            name=name,
            policy=policy,
            number=number_cell(value),
            over=plural(pixels[policy == "exclude"], "pixel", "pixels"),
        )
        for name, by_policy in summary.pooled.items()
        for policy, value in by_policy.items()
    ]
    note = (
        "The angle between prediction and ground truth over all valid pixels of the scored images, "
        "in degrees, and the shares strictly below 5, 7.5, 11.25, 22.5 and 30 degrees. Holes are "
        "pixels with a measured normal and no prediction: error_90 (primary) counts each as 90 "
        "degrees, fails counts it in no share, exclude leaves it out."
    )
    (means,) = metric_parts(summary)
    return [
        MetricPart(title="All pixels pooled", rows=pooled, note=note),
        MetricPart(
            title="Means over images",
            rows=[*means.rows, *attempted_rows(summary, ANGLES[0])],
            note="",
        ),
    ]


def normals_notes(summary: NormalsSummary) -> list[str]:
    """What the numbers hide: images without a score, holes, resampled predictions."""
    by_status = ", ".join(f"{n} {name}" for name, n in summary.coverage.by_status.items())
    lines = [
        f"images: {by_status}; {summary.resampled} resampled, "
        f"{plural(summary.warnings, 'warning', 'warnings')}",
        f"mean share of truth pixels that are holes: {fraction(summary.mean_hole_share)}",
        *list_unscored(summary),
    ]
    return lines + ["partial run: only some images of its track"] * summary.partial


def _degrees(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


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
    live=live_pixels(PIXELS),
)
