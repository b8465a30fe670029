"""The row of one image of a depth evaluation: status, coverage, metrics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Final

from msgspec.structs import asdict, replace

from legoworld.depth_files.errors import DepthFileError
from legoworld.evaluation.depth.errors import DepthMissingError, DepthPredictionError
from legoworld.evaluation.depth.eth3d import scene_of
from legoworld.evaluation.depth.predictions import DepthImage, load_prediction
from legoworld.evaluation.depth.protocol import HOLE_POLICIES, DepthProtocol
from legoworld.evaluation.depth.resampling import Sample, check_size, sampler
from legoworld.evaluation.depth.scoring import ImageScore, score_image, valid_truth
from legoworld.evaluation.depth.truth import DepthTruth, TruthFile, load_truth
from legoworld.evaluation.depth.view import small_view
from legoworld.records.evaluation_rows import DepthRow, Metrics, ScoredDepthRow, UnscoredDepthRow
from legoworld.records.evaluation_view import DepthView
from legoworld.tracks.colmap import Camera

#: Explanations of flagged fits. A disparity declared as depth can score well; only the sign tells.
_FLAGS: Final = {
    "inverted": "the prediction falls where the truth rises: is its space declared right?",
    "degenerate": "the best fit is a constant: one side does not vary, or they are unrelated",
}
#: Equal but for rounding is not worse.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, kw_only=True)
class ImageResult:
    """A per_image row, and the image's view (None if not scored)."""

    row: DepthRow
    view: DepthView | None


def score_row(
    image: DepthImage, file: TruthFile, camera: Camera | None, protocol: DepthProtocol
) -> ImageResult:
    """Score one image; both arrays are read here and freed on return.

    camera: the ground truth's distorted camera if predictions are pinhole views to be warped.
    Errors of the prediction become the row's status and reason; errors of the ground truth are
    raised.
    """
    truth = load_truth(file)
    row = _truth_row(image, file, truth)
    if row.n_valid < protocol.min_valid_px:
        reason = f"{row.n_valid} valid truth pixels, {protocol.min_valid_px} are needed"
        return ImageResult(row=replace(row, status="no_gt", reason=reason), view=None)
    if image.image.status != "ok":
        row = replace(row, status=image.image.status, reason=image.reason)
        return ImageResult(row=row, view=None)
    try:
        return _predicted_row(row, image, truth, camera, protocol)
    except (DepthMissingError, DepthPredictionError, DepthFileError) as error:
        row = replace(row, status=error.status, code=error.code, reason=str(error))
    except MemoryError:
        reason = "there is not enough memory to score it: use fewer workers"
        row = replace(row, status="invalid", code="memory", reason=reason)
    return ImageResult(row=row, view=None)


def _predicted_row(
    truth_row: UnscoredDepthRow,
    image: DepthImage,
    truth: DepthTruth,
    camera: Camera | None,
    protocol: DepthProtocol,
) -> ImageResult:
    """The ground truth's row extended by the prediction; raises errors of the prediction."""
    prediction = load_prediction(image, partial(check_size, truth_wh=truth.size_wh))
    sample = sampler(prediction, truth.size_wh, camera)
    row = replace(
        truth_row,
        prediction_wh=prediction.size_wh,
        space=prediction.space,
        unit=prediction.unit,
        resampled=prediction.size_wh != truth.size_wh,
        warped=camera is not None,
    )
    return _scored(row, truth, sample, score_image(truth.z_m, sample, protocol), protocol)


def _truth_row(image: DepthImage, file: TruthFile, truth: DepthTruth) -> UnscoredDepthRow:
    step = max(1, (1 << 20) // truth.size_wh[0])
    starts = range(0, truth.size_wh[1], step)
    n_valid = sum(int(valid_truth(truth.z_m[i : i + step]).sum()) for i in starts)
    warnings = []
    if file.size_from == "track":
        warnings.append("no cameras.txt: the truth's size is the track's, held to its bytes")
    if truth.nan_px or truth.non_positive_px:
        warnings.append(
            f"invalid truth left out: {truth.nan_px} NaN, {truth.non_positive_px} not positive"
        )
    return UnscoredDepthRow(
        image_id=image.image.image_id,
        file_name=image.image.file_name,
        group=scene_of(image.image.file_name) or image.image.file_name,
        status="",
        code=None,
        reason=None,
        run_status=image.image.status,
        truth_wh=truth.size_wh,
        n_valid=n_valid,
        truth_inf_px=truth.inf_px,
        truth_nan_px=truth.nan_px,
        truth_non_positive_px=truth.non_positive_px,
        warnings=tuple(warnings),
    )


def _scored(
    row: UnscoredDepthRow,
    truth: DepthTruth,
    sample: Sample,
    score: ImageScore,
    protocol: DepthProtocol,
) -> ImageResult:
    counts = score.counts
    row = replace(
        row,
        n_predicted=counts.predicted,
        hole_share=1.0 - counts.predicted / counts.truth,
        outside_view_share=counts.outside / counts.truth,
    )
    if score.fit is None or score.metrics is None or score.constant is None:
        reason = (
            f"{counts.predicted} of {counts.truth} valid truth pixels have a prediction,"
            f" {protocol.min_valid_px} are needed"
        )
        row = replace(row, status="invalid", code="too_few_pixels", reason=reason)
        return ImageResult(row=row, view=None)
    worse = worse_than_constant(score.metrics, score.constant)
    warnings = list(row.warnings)
    if score.fit.status in _FLAGS:
        warnings.append(_FLAGS[score.fit.status])
    if worse:
        warnings.append(f"AbsRel is above that of a constant under {', '.join(worse)}")
    known = asdict(replace(row, status=score.fit.status, warnings=tuple(warnings)))
    scored = ScoredDepthRow(
        **known,
        s=score.fit.scale,
        t=score.fit.shift,
        clamped_share=counts.clamped / counts.predicted,
        deepest_truth_z_m=score.deepest_z_m,
        metrics=score.metrics,
        constant=score.constant,
        worse_than_constant=worse,
    )
    return ImageResult(row=scored, view=small_view(truth.z_m, sample, score.fit, score.deepest_z_m))


def worse_than_constant(metrics: Metrics, constant: Metrics) -> tuple[str, ...]:
    """The hole policies under which AbsRel exceeds that of the zero-information constant."""
    ours, zero = metrics["abs_rel"], constant["abs_rel"]
    return tuple(p for p in HOLE_POLICIES if ours[p] > zero[p] * (1.0 + _ROUNDING) + _ROUNDING)
