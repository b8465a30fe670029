"""scene_camera.json and camera.json of BOP, as BlenderProc's BopWriter writes them.

cam_R_w2c and cam_t_w2c are cam_from_world with OpenCV camera axes, translations in millimetres.
cam_K has the centre of the first pixel at 0: BlenderProc's cx is (width - 1) / 2 without shift.
"""

from __future__ import annotations

from pathlib import Path

from legoworld.camera_files.colmap import invert_pose
from legoworld.records.base import Record, RecordError, decode
from legoworld.tracks.colmap import CalibrationError
from legoworld.visibility.posed_camera import Camera

_Nine = tuple[float, float, float, float, float, float, float, float, float]


class _Size(Record, frozen=True, kw_only=True):
    width: int
    height: int


class _View(Record, frozen=True, kw_only=True):
    cam_K: _Nine  # noqa: N815  the file's key
    cam_R_w2c: _Nine  # noqa: N815
    cam_t_w2c: tuple[float, float, float]


def read_bop(path: Path) -> list[Camera]:
    """The views of a scene_camera.json, by number. Raises CalibrationError.

    The pictures' size is that of the nearest camera.json beside or above it.
    """
    size_file = next((f for p in path.parents if (f := p / "camera.json").is_file()), None)
    if size_file is None:
        raise CalibrationError(
            f"the picture size of {path.name} is not known",
            found="no camera.json beside or above it",
            expected="camera.json with width and height",
        )
    try:
        size = decode(_Size, size_file.read_bytes())
        views = decode(dict[int, _View], path.read_bytes())
    except (OSError, RecordError) as error:
        raise CalibrationError(
            f"{path.name} cannot be read",
            found=str(error),
            expected="BOP's scene_camera.json with cam_K, cam_R_w2c and cam_t_w2c",
        ) from error
    return [_camera(number, view, size) for number, view in sorted(views.items())]


def _camera(number: int, view: _View, size: _Size) -> Camera:
    fx, _, cx, _, fy, cy, *_ = view.cam_K
    r = view.cam_R_w2c
    metres = tuple(t / 1000 for t in view.cam_t_w2c)
    return Camera(
        name=f"{number:06d}",
        world_from_cam=invert_pose([list(r[:3]), list(r[3:6]), list(r[6:])], metres),
        size_wh=(size.width, size.height),
        fx=fx,
        fy=fy,
        cx=cx + 0.5,
        cy=cy + 0.5,
    )
