"""The numbers of one image of normals."""

from __future__ import annotations

from typing import Final

from msgspec.structs import asdict, replace

from legoworld.evaluation.normals.angles import angular_errors, image_metrics, summed
from legoworld.evaluation.normals.arrays import SIGNS
from legoworld.evaluation.normals.errors import NormalsPredictionError
from legoworld.evaluation.pixels.family import ImageResult, Measuring
from legoworld.evaluation.pixels.resampling import sampler
from legoworld.evaluation.pixels.rows import too_few, with_holes
from legoworld.records.normals import NormalsRow, ScoredNormalsRow

#: Mean error from which the array turned around has one below 45 degrees.
_TURNED_DEG: Final = 180.0 - 45.0


def measure_normals(image: Measuring) -> ImageResult:
    """Score one image. NormalsPredictionError where the prediction's sign cannot be as stated."""
    row: NormalsRow = replace(image.row, sign=image.prediction.sign)
    sample = sampler(image.prediction, image.truth.size_wh)
    errors = angular_errors(image.truth.values, sample, row.n_valid)
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
    return ImageResult(row=scored)
