"""The numbers of one image of depth, and its view."""

from __future__ import annotations

from functools import partial
from typing import Final

from msgspec.structs import asdict, replace

from legoworld.errors import ShapeError
from legoworld.evaluation.depth.alignment import aligned_z
from legoworld.evaluation.depth.cameras import pinhole_from_distorted
from legoworld.evaluation.depth.protocol import HOLE_POLICIES, DepthProtocol
from legoworld.evaluation.depth.scoring import ImageScore, score_image, valid_truth
from legoworld.evaluation.pixels.family import ImageResult, Measuring, PixelTruth
from legoworld.evaluation.pixels.resampling import Sample, Warp, sampler
from legoworld.evaluation.pixels.rows import too_few, with_holes
from legoworld.evaluation.pixels.view import encoded, shown_pixels
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.depth import DepthRow, ScoredDepthRow
from legoworld.records.evaluation_view import DepthView, Fit
from legoworld.records.pixels import Metrics
from legoworld.tracks.colmap import Camera

#: Explanations of flagged fits. A disparity declared as depth can score well; only the sign tells.
_FLAGS: Final = {
    "inverted": "the prediction falls where the truth rises: is its space declared right?",
    "degenerate": "the best fit is a constant: one side does not vary, or they are unrelated",
}
#: Equal but for rounding is not worse.
_ROUNDING: Final = 1e-9


def measure_depth(image: Measuring) -> ImageResult:
    """Align, score and show one image.

    camera_model "dataset": predictions are pinhole views, warped to the truth's distorted camera.
    """
    camera: Camera | None = None
    if image.options["camera_model"] == "dataset":
        camera = image.file.camera
    sample = sampler(image.prediction, image.truth.size_wh, warp_of(camera, image.truth.size_wh))
    row = replace(
        image.row,
        space=image.prediction.space,
        unit=image.prediction.unit,
        warped=camera is not None,
    )
    score = score_image(image.truth.values, sample, image.protocol)
    return _score_row(row, image.truth, sample, score, image.protocol)


def warp_of(camera: Camera | None, truth_wh: tuple[int, int]) -> Warp | None:
    """How positions in the photo of a distorted camera become those in its pinhole's view."""
    if camera is None:
        return None
    if camera.size_wh != truth_wh:
        raise ShapeError(
            "a camera of another size", found=str(camera.size_wh), expected=str(truth_wh)
        )
    return partial(pinhole_from_distorted, camera)


def _score_row(
    row: DepthRow,
    truth: PixelTruth,
    sample: Sample,
    score: ImageScore,
    protocol: DepthProtocol,
) -> ImageResult:
    counts = score.counts
    row = with_holes(row, counts.predicted)
    row = replace(row, outside_view_share=counts.outside / counts.truth)
    if score.fit is None or score.metrics is None or score.constant is None:
        return too_few(row, counts.predicted, protocol.min_valid_px)
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
    return ImageResult(row=scored, view=_view(truth, sample, score.fit, score.deepest_z_m))


def _view(truth: PixelTruth, sample: Sample, fit: Fit, deepest_z_m: float) -> DepthView:
    """A small view of the truth and of the aligned prediction, in metres."""
    shown = shown_pixels(truth.values, valid_truth)
    true_z_m, sampled = truth.values[shown.rows, shown.cols], sample(shown.rows, shown.cols)
    z_m, _ = aligned_z(sampled.values, fit, 1.0 / deepest_z_m)
    return DepthView(
        size_wh=shown.size_wh,
        image_wh=truth.size_wh,
        truth_z_m=encoded(true_z_m, valid_truth(true_z_m), DEPTH_FILE.hole),
        aligned_z_m=encoded(z_m, sampled.predicted, DEPTH_FILE.hole),
        fit=fit,
    )


def worse_than_constant(metrics: Metrics, constant: Metrics) -> tuple[str, ...]:
    """The hole policies under which AbsRel exceeds that of the zero-information constant."""
    ours, zero = metrics["abs_rel"], constant["abs_rel"]
    return tuple(p for p in HOLE_POLICIES if ours[p] > zero[p] * (1.0 + _ROUNDING) + _ROUNDING)
