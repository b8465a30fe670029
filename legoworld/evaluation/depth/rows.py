"""The numbers of one image of depth, and its view; the cameras of ETH3D's photos."""

from __future__ import annotations

from functools import partial
from typing import Final, cast

import numpy as np
from msgspec.structs import asdict, replace

from legoworld.errors import ShapeError
from legoworld.evaluation.depth.arrays import CameraModelError
from legoworld.evaluation.depth.protocol import HOLE_POLICIES, DepthProtocol
from legoworld.evaluation.depth.scoring import ImageScore, aligned_z, score_image, valid_truth
from legoworld.evaluation.pixels.family import F64, ImageResult, Measuring, PixelTruth
from legoworld.evaluation.pixels.resampling import Sample, Warp, encode_array, sampler, shown_pixels
from legoworld.evaluation.pixels.rows import too_few, with_holes
from legoworld.pluralize import plural
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.depth import DepthRow, DepthView, Fit, ScoredDepthRow
from legoworld.records.pixels import Metrics
from legoworld.tracks.colmap import Camera
from legoworld.visibility.lens import Coefficients, Lens, undistort

#: Number of parameters by model, in the order of cameras.txt.
#: PINHOLE: fx fy cx cy; THIN_PRISM_FISHEYE: fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1.
PARAMETERS: Final = {"PINHOLE": 4, "THIN_PRISM_FISHEYE": 12}


def pinhole_from_distorted(camera: Camera, distorted_xy_px: F64) -> F64:
    """Map distorted pixels to those of the pinhole camera with the same fx, fy, cx, cy.

    distorted_xy_px and the result: (n, 2), x and y from the top left corner of the image.
    CameraModelError if the model is unknown or a pixel has no ray in front of the camera.
    """
    if camera.model not in PARAMETERS or len(camera.params) != PARAMETERS[camera.model]:
        raise CameraModelError(
            "unknown camera model",
            found=f"{camera.model} with {len(camera.params)} parameters",
            expected=", ".join(f"{name} with {n}" for name, n in PARAMETERS.items()),
            next_step="score with --camera-model none",
        )
    if camera.model == "PINHOLE":
        return distorted_xy_px
    fx, fy, cx, cy = camera.params[:4]
    lens = Lens(coefficients=cast("Coefficients", camera.params[4:]), fisheye=True)
    found = undistort(lens, (fx, fy), (cx, cy), distorted_xy_px)
    for pixels, why in (
        (found.folded, "the distortion folds over"),
        (found.unsolved, "the distortion has no inverse that is found"),
        (found.behind, "90 degrees or more off axis"),
    ):
        if pixels.any():
            raise CameraModelError(
                "the camera model has no ray for a pixel",
                found=f"{why} ({plural(int(np.count_nonzero(pixels)), 'pixel', 'pixels')})",
                expected="a distortion that is invertible over the whole image",
                next_step="check the parameters in cameras.txt, or score with --camera-model none",
            )
    return found.xy_px


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
    sample = sampler(
        image.prediction, image.truth.size_wh, camera_warp(camera, image.truth.size_wh)
    )
    row = replace(
        image.row,
        space=image.prediction.space,
        unit=image.prediction.unit,
        warped=camera is not None,
    )
    score = score_image(image.truth.values, sample, image.protocol)
    return _score_row(row, image.truth, sample, score, image.protocol)


def camera_warp(camera: Camera | None, truth_wh: tuple[int, int]) -> Warp | None:
    """How positions in the photo of a distorted camera become those in its pinhole's view.

    Both (n, 2) in pixels. Raises ShapeError for a camera whose size is not the truth's.
    """
    if camera is None:
        return None
    if camera.size_wh != truth_wh:
        raise ShapeError(
            "a camera of another size", found=str(camera.size_wh), expected=str(truth_wh)
        )
    return partial(pinhole_from_distorted, camera)


def _score_row(
    row: DepthRow, truth: PixelTruth, sample: Sample, score: ImageScore, protocol: DepthProtocol
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
        truth_z_m=encode_array(true_z_m, valid_truth(true_z_m), DEPTH_FILE.hole),
        aligned_z_m=encode_array(z_m, sampled.predicted, DEPTH_FILE.hole),
        fit=fit,
    )


def worse_than_constant(metrics: Metrics, constant: Metrics) -> tuple[str, ...]:
    """The hole policies under which AbsRel exceeds that of the zero-information constant."""
    ours, zero = metrics["abs_rel"], constant["abs_rel"]
    return tuple(p for p in HOLE_POLICIES if ours[p] > zero[p] * (1.0 + _ROUNDING) + _ROUNDING)
