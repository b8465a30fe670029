"""The ground truth of a run's images: located before scoring, read one image at a time."""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.read_depth import check_raw_float32, read_raw_float32
from legoworld.errors import LegoWorldError
from legoworld.evaluation.depth.arrays import (
    DECLARATION,
    Declaration,
    DepthArray,
    DepthTruthError,
    ray_lengths,
    read_declaration,
)
from legoworld.evaluation.depth.eth3d import Eth3dFiles, find_files, photo_camera
from legoworld.evaluation.depth.labelled import per_metre, read_labelled
from legoworld.evaluation.pixels.family import PixelTruth, TruthFile
from legoworld.evaluation.pixels.labelled import find_all_truth, find_array
from legoworld.records.run_rows import RunImage
from legoworld.tracks.colmap import Calibration, Camera, read_calibration

_BAND_ROWS: Final = 64


@dataclass(frozen=True, kw_only=True)
class DepthTruthFile(TruthFile):
    """One image's ground truth. size_wh, camera: from ETH3D's calibration, None otherwise.

    calibration: the files these two were read from.
    """

    kind: Literal["eth3d_raw", "array"]
    declared: Declaration = field(default_factory=Declaration)
    size_wh: tuple[int, int] | None = None
    size_from: Literal["cameras.txt", "track", "file"] = "file"
    camera: Camera | None = None


def find_truth(truth: Path, images: Sequence[RunImage]) -> tuple[DepthTruthFile, ...]:
    """The ground truth of every image, in image order; sizes and first bytes are checked.

    ETH3D's tree (or Marigold's) is tried first, then an array named like the photo. Raises
    DepthTruthError or DepthFileError: nothing is scored against incomplete ground truth.
    """
    declared = read_declaration(truth)
    calibrations: dict[Path, Calibration] = {}
    return find_all_truth(
        truth,
        images,
        lambda image: _eth3d(truth, image, calibrations) or _array(truth, image, declared),
        noun="depth",
        layout="ETH3D's <scene>/ground_truth_depth/dslr_images/",
        error=DepthTruthError,
    )


def load_truth(file: DepthTruthFile) -> PixelTruth:
    """Read one ground truth as planar metres and count its invalid values."""
    if file.kind == "eth3d_raw":
        assert file.size_wh is not None
        z_m: NDArray[Any] = read_raw_float32(file.path, file.size_wh)
    else:
        z_m = planar_metres(read_labelled(file.path, file.declared), file.declared, file.path.name)
    unsure = ("no cameras.txt: the truth's size is the track's, held to its bytes",)
    return make_truth(z_m, unsure if file.size_from == "track" else ())


def make_truth(z_m: NDArray[Any], warnings: tuple[str, ...] = ()) -> PixelTruth:
    """Planar metres (H, W) as ground truth, with the counts of its invalid values."""
    counts = np.zeros(3, np.int64)
    for start in range(0, len(z_m), _BAND_ROWS):
        band = z_m[start : start + _BAND_ROWS]
        counts += [np.count_nonzero(x) for x in (band == np.inf, np.isnan(band), band <= 0)]
    inf_px, nan_px, non_positive_px = (int(n) for n in counts)
    if nan_px or non_positive_px:
        left_out = f"invalid truth left out: {nan_px} NaN, {non_positive_px} not positive"
        warnings = (*warnings, left_out)
    return PixelTruth(
        values=z_m,
        counts={
            "truth_inf_px": inf_px,
            "truth_nan_px": nan_px,
            "truth_non_positive_px": non_positive_px,
        },
        warnings=tuple(warnings),
    )


def planar_metres(array: DepthArray, declared: Declaration, source: str) -> NDArray[Any]:
    """Ground truth in any declared space as (H, W) planar z in metres; it needs a unit.

    A disparity becomes z = focal * baseline / (d + doffs); z is inf where it is inf (Middlebury's
    "unknown") or d + doffs is not positive.
    """
    if array.space == "disparity":
        return _from_disparity(array, declared, source)
    count = per_metre(array.unit)
    if count is None:
        raise DepthTruthError(
            f"{source} is ground truth without a unit",
            found=f"unit {array.unit!r}",
            expected="m, mm or m/N",
            next_step=f'declare it in {DECLARATION}: unit = "m"',
        )
    if array.space == "depth" and array.unit == "m":
        return array.values
    z_m = np.empty(array.values.shape, np.float64)
    cols = np.arange(z_m.shape[1])[None, :]
    for start in range(0, len(z_m), _BAND_ROWS):
        band = array.values[start : start + _BAND_ROWS].astype(np.float64) / count
        if array.space == "ray_distance":
            assert array.intrinsics_px is not None
            rows = np.arange(start, start + len(band))[:, None]
            band /= ray_lengths(array.intrinsics_px, rows, cols)
        z_m[start : start + _BAND_ROWS] = band
    return z_m


def _from_disparity(array: DepthArray, declared: Declaration, source: str) -> NDArray[np.float64]:
    focal, baseline, doffs = declared.focal_px, declared.baseline_m, declared.doffs_px
    if focal is None or baseline is None or doffs is None or array.unit != "px":
        raise DepthTruthError(
            f"{source} is a disparity without the stereo parameters",
            found=f"unit {array.unit!r}, focal_px {focal}, baseline_m {baseline}, doffs_px {doffs}",
            expected='unit = "px", focal_px, baseline_m and doffs_px (0 when there is none)',
            next_step=f"declare them in {DECLARATION}",
        )
    z_m = np.full(array.values.shape, np.inf)
    for start in range(0, len(z_m), _BAND_ROWS):
        shifted = array.values[start : start + _BAND_ROWS].astype(np.float64) + doffs
        band = z_m[start : start + _BAND_ROWS]
        np.divide(focal * baseline, shifted, out=band, where=np.isfinite(shifted) & (shifted > 0))
        band[np.isnan(shifted)] = np.nan
    return z_m


def _eth3d(
    truth: Path, image: RunImage, calibrations: MutableMapping[Path, Calibration]
) -> DepthTruthFile | None:
    """An image's raw depth. calibrations: those read so far, by folder; gains the image's own."""
    files = find_files(truth, image.file_name)
    if files is None:
        return None
    folder = files.calibration
    if folder is not None and folder not in calibrations:
        calibrations[folder] = read_calibration(folder)
    calibration = calibrations[folder] if folder is not None else None
    camera = photo_camera(calibration, files.name) if calibration else None
    size_wh = camera.size_wh if camera else image.size_wh
    if size_wh is None:
        raise _unknown_size(files)
    if image.size_wh is not None and size_wh != image.size_wh:
        raise DepthTruthError(
            f"the run's {image.file_name} and its camera have different sizes",
            found=f"{image.size_wh[0]}x{image.size_wh[1]} in the run",
            expected=f"{size_wh[0]}x{size_wh[1]} in cameras.txt",
            next_step="make the track from this dataset",
        )
    check_raw_float32(files.depth, size_wh)
    return DepthTruthFile(
        kind="eth3d_raw",
        path=files.depth,
        size_wh=size_wh,
        size_from="cameras.txt" if camera else "track",
        camera=camera,
        calibration=calibration.files if calibration else (),
    )


def _array(truth: Path, image: RunImage, declared: Declaration) -> DepthTruthFile | None:
    path = find_array(truth, image, noun="depth", error=DepthTruthError)
    return DepthTruthFile(kind="array", path=path, declared=declared) if path else None


def _unknown_size(files: Eth3dFiles) -> LegoWorldError:
    return DepthTruthError(
        f"the size of {files.scene}/{files.name} is not known",
        found="no dslr_calibration_jpg/cameras.txt, and the run has no image size",
        expected="cameras.txt of the scene, or a track with sizes",
    )
