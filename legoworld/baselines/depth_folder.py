"""Imported depth arrays: a folder that mirrors the track, each array declared and planar."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import SizeCheck
from legoworld.errors import LegoWorldError
from legoworld.evaluation.depth.arrays import (
    DECLARATION,
    Declaration,
    DepthArray,
    DepthPredictionError,
    Intrinsics,
    checked_array,
    ray_lengths,
)
from legoworld.evaluation.depth.family import PIXELS
from legoworld.evaluation.depth.labelled import read_labelled
from legoworld.evaluation.pixels.resampling import size_check
from legoworld.files import write_npz
from legoworld.records.base import RecordError, decode, to_record
from legoworld.records.baseline_messages import CameraEntry
from legoworld.tracks.track import TrackImage

_DECLARE: Final = (
    "say it with --space, and integers with --unit (disparity: as float32); name an array of "
    "several with --array"
)


class IntrinsicsError(LegoWorldError):
    """The intrinsics file is unusable."""

    code = "intrinsics"


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A pinhole camera. size_wh: the array size of its numbers, None if the file does not say."""

    intrinsics_px: Intrinsics
    size_wh: tuple[int, int] | None


@dataclass(frozen=True, kw_only=True)
class DepthDeclarations:
    """What is declared of a folder's arrays.

    cameras: by file name; "" applies to every photo. array: the name in an .npz or .exr.
    """

    space: str | None
    unit: str | None
    cameras: Mapping[str, Camera]
    array: str | None


def planar_depth(source: DepthDeclarations, path: Path, image: TrackImage) -> DepthArray:
    """A photo's array after all checks; ray distances are converted to planar depth.

    DepthFileError if the array's quantity is undeclared or cannot be converted to depth;
    DepthPredictionError if it cannot be scored: of the wrong size, or without any prediction.
    """
    assert image.size_wh is not None
    camera = source.cameras.get(image.file_name, source.cameras.get(""))
    array = _read_declared_array(path, source, camera, size_check(PIXELS, image.size_wh))
    if camera and camera.size_wh not in (None, array.size_wh):
        raise DepthFileError(
            f"{path.name} is of another size than its intrinsics",
            found="{}x{}".format(*array.size_wh),
            expected="{}x{}".format(*(camera.size_wh or (0, 0))),
            next_step="scale fx, fy, cx, cy to the array's size",
        )
    predicted_px(array, image)
    if array.space != "ray_distance":
        return array
    assert array.intrinsics_px is not None
    return checked_array(
        planar_from_ray_distance(array.values, array.intrinsics_px),
        space="depth",
        unit=array.unit,
        intrinsics_px=None,
        source=path.name,
        stored=array.stored,
    )


def predicted_px(array: DepthArray, image: TrackImage) -> int:
    """The number of pixels with a prediction, as in scoring (`DepthArray.at`).

    DepthPredictionError for an array that cannot be scored: of the wrong size, or without a
    prediction at any pixel.
    """
    assert image.size_wh is not None
    size_check(PIXELS, image.size_wh)(array.size_wh)
    predicted = array.prediction_mask(array.values)
    if not predicted.any():
        raise DepthPredictionError(
            "the depth has no prediction at any pixel",
            found="no finite number" + ("" if array.space == "disparity" else " above 0"),
            expected="finite numbers" + ("" if array.space == "disparity" else " above 0"),
        )
    return int(predicted.sum())


def _read_declared_array(
    path: Path, source: DepthDeclarations, camera: Camera | None, check: SizeCheck
) -> DepthArray:
    """The array as declared by the file or the command; a missing part names the option."""
    declared = Declaration(
        space=source.space,
        unit=source.unit,
        array=source.array,
        intrinsics_px=camera.intrinsics_px if camera else None,
    )
    try:
        return read_labelled(path, declared, check_size=check, accept_float16=True)
    except DepthFileError as error:
        undeclared = DECLARATION in error.next_step or error.next_step.startswith("declare")
        raise DepthFileError(
            error.what,
            found=error.found,
            expected=error.expected,
            next_step=_DECLARE if undeclared else error.next_step,
        ) from error


def planar_from_ray_distance(distance: NDArray[Any], intrinsics_px: Intrinsics) -> NDArray[Any]:
    """Planar z of (H, W) distances from a pinhole's centre, in the distances' unit and type.

    The ray through the centre of pixel (column u, row v) has the direction
    ((u + 0.5 - cx) / fx, (v + 0.5 - cy) / fy, 1) with fx, fy, cx, cy at this array's size and the
    origin at the top left corner of the top left pixel (Hartley and Zisserman, Multiple View
    Geometry, 2nd edition, section 6.1). A point at distance d along it has z = d over that
    direction's length. Computed in float64; NaN and inf are kept.
    """
    rows, cols = np.ogrid[: distance.shape[0], : distance.shape[1]]
    planar: NDArray[Any] = distance.astype(np.float64) / ray_lengths(intrinsics_px, rows, cols)
    return planar.astype(distance.dtype)


def write_array(path: Path, array: DepthArray) -> None:
    """Write an array with its declaration as the run's .npz, atomically."""
    labels = {"space": np.array(array.space), "unit": np.array(array.unit or "")}
    write_npz(path, {"values": array.values, **labels})


def read_cameras_file(path: Path) -> dict[str, Camera]:
    """Intrinsics: one camera for all photos (key ""), or one per file name.

    A camera is {"fx", "fy", "cx", "cy"} in pixels, with "width" and "height" if they are not at the
    arrays' own size. IntrinsicsError for any other content.
    """
    try:
        document = decode(dict[str, Any], path.read_bytes())
        if "fx" in document:
            return {"": _camera(to_record(CameraEntry, document))}
        entries = to_record(dict[str, CameraEntry], document)
        return {name: _camera(entry) for name, entry in entries.items()}
    except (OSError, RecordError) as error:
        raise IntrinsicsError(
            f"the intrinsics {path.name} cannot be used",
            found=str(error),
            expected='{"fx", "fy", "cx", "cy", "width", "height"}, or such an object by file name',
        ) from error


def _camera(entry: CameraEntry) -> Camera:
    if (entry.width is None) != (entry.height is None):
        raise RecordError("one of width and height alone")
    size = (entry.width, entry.height) if entry.width and entry.height else None
    return Camera(intrinsics_px=(entry.fx, entry.fy, entry.cx, entry.cy), size_wh=size)
