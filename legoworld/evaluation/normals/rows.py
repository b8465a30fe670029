"""The numbers of one image of normals."""

from __future__ import annotations

from typing import Final, cast

import numpy as np
from msgspec.structs import asdict, replace

from legoworld.evaluation.normals.angles import angular_errors, bins_of, image_metrics, summed
from legoworld.evaluation.normals.arrays import SIGNS, unit_vectors, valid_normals
from legoworld.evaluation.normals.errors import NormalsPredictionError
from legoworld.evaluation.pixels.family import ImageResult, Measuring, PixelTruth
from legoworld.evaluation.pixels.resampling import Sample, sampler
from legoworld.evaluation.pixels.rows import too_few, with_holes
from legoworld.evaluation.pixels.view import encoded, shown_pixels
from legoworld.readouts.normals import NORMALS_FILE
from legoworld.records.evaluation_view import NormalsView
from legoworld.records.normals import NormalsRow, ScoredNormalsRow

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
        there = np.isin(bins_of(errors), cast("list[int]", image.options["bins"]))
        return ImageResult(row=row, view=errors[there])
    row = with_holes(row, len(errors))
    if len(errors) < image.protocol.min_valid_px:
        return too_few(row, len(errors), image.protocol.min_valid_px)
    sums = summed(errors)
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
        truth=encoded(unit_vectors(true), valid_normals(true), NORMALS_FILE.hole),
        predicted=encoded(unit_vectors(sampled.values), sampled.predicted, NORMALS_FILE.hole),
    )
