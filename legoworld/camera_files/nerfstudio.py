"""transforms.json of nerfstudio, instant-ngp and NeRF's synthetic scenes.

transform_matrix is world_from_cam with OpenGL camera axes (x right, y up, z backwards), in the
file's own world: `applied_transform` is part of it. fl_x, fl_y, cx, cy are COLMAP's, in pixels from
the corner; camera_angle_x is the horizontal field of view.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final, cast

from msgspec import UNSET, UnsetType

from legoworld.camera_files.colmap import make_lens
from legoworld.records.base import Record, RecordError, decode
from legoworld.tracks.colmap import CalibrationError
from legoworld.visibility.posed_camera import Camera, Pose

_Number = float | UnsetType
_FISHEYE: Final = "OPENCV_FISHEYE"
_MODELS: Final = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", _FISHEYE)


class _Lens(Record, frozen=True, kw_only=True):
    """What a frame may say for itself, and the file for all."""

    camera_model: str | UnsetType = UNSET
    camera_angle_x: _Number = UNSET
    w: _Number = UNSET
    h: _Number = UNSET
    fl_x: _Number = UNSET
    fl_y: _Number = UNSET
    cx: _Number = UNSET
    cy: _Number = UNSET
    k1: _Number = UNSET
    k2: _Number = UNSET
    k3: _Number = UNSET
    k4: _Number = UNSET
    p1: _Number = UNSET
    p2: _Number = UNSET


class _Frame(_Lens, frozen=True, kw_only=True):
    file_path: str
    transform_matrix: list[list[float]]


class _Transforms(_Lens, frozen=True, kw_only=True):
    frames: list[_Frame]


def read_transforms(path: Path) -> list[Camera]:
    """The frames of a file, in its order. Raises CalibrationError."""
    try:
        file = decode(_Transforms, path.read_bytes())
    except (OSError, RecordError) as error:
        raise CalibrationError(
            f"{path.name} cannot be read",
            found=str(error),
            expected="nerfstudio's transforms.json: frames with file_path and transform_matrix",
        ) from error
    return [_camera(path, file, frame) for frame in file.frames]


def _camera(path: Path, file: _Transforms, frame: _Frame) -> Camera:
    def frame_setting(name: str) -> Any:
        own = getattr(frame, name)
        return getattr(file, name) if own is UNSET else own

    model = frame_setting("camera_model")
    if model is not UNSET and model not in _MODELS:
        raise _unusable(path, frame, f"camera_model {model}", ", ".join(_MODELS))
    try:
        rows = pose_from_opengl(frame.transform_matrix)
    except ValueError as error:
        raise _unusable(
            path, frame, f"a transform_matrix of {error}", "4 rows of 4 numbers"
        ) from error
    width, height, fl_x = frame_setting("w"), frame_setting("h"), frame_setting("fl_x")
    if width is UNSET or height is UNSET:
        raise _unusable(path, frame, "no w and h", "the picture's width and height")
    if fl_x is UNSET:
        angle = frame_setting("camera_angle_x")
        if angle is UNSET:
            raise _unusable(path, frame, "no focal length", "fl_x, or camera_angle_x")
        fl_x = width / 2 / math.tan(angle / 2)
    fl_y, cx, cy = frame_setting("fl_y"), frame_setting("cx"), frame_setting("cy")
    given = {name: frame_setting(name) for name in ("k1", "k2", "k3", "k4", "p1", "p2")}
    bends = {name: value for name, value in given.items() if value is not UNSET}
    return Camera(
        name=frame.file_path,
        world_from_cam=rows,
        size_wh=(int(width), int(height)),
        fx=fl_x,
        fy=fl_x if fl_y is UNSET else fl_y,
        cx=width / 2 if cx is UNSET else cx,
        cy=height / 2 if cy is UNSET else cy,
        lens=make_lens(bends, fisheye=model == _FISHEYE),
    )


def pose_from_opengl(matrix: list[list[float]]) -> Pose:
    """world_from_cam of one with OpenGL's and Blender's axes. ValueError: not 4 x 4."""
    if len(matrix) not in (3, 4) or any(len(row) != 4 for row in matrix):
        raise ValueError(f"{len(matrix)} rows")
    return cast("Pose", tuple((r[0], -r[1], -r[2], r[3]) for r in matrix[:3]))


def _unusable(path: Path, frame: _Frame, found: str, expected: str) -> CalibrationError:
    return CalibrationError(
        f"frame {frame.file_path!r} of {path.name} cannot be used", found=found, expected=expected
    )
