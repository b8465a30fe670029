"""BlenderProc's .hdf5 files, one for each frame, where its CameraStateWriter added `campose`.

campose is JSON: cam2world_matrix with Blender's camera axes, in scene units, and cam_K with the
centre of the first pixel at 0. The picture's size is that of the arrays beside it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from legoworld import extras
from legoworld.camera_files.nerfstudio import pose_from_opengl
from legoworld.records.base import Record, RecordError, decode
from legoworld.tracks.colmap import CalibrationError
from legoworld.visibility.posed_camera import Camera

SUFFIX: Final = ".hdf5"
#: Arrays (height, width, ...) that `write_hdf5` has names for.
_PICTURES: Final = (
    "colors", "normals", "depth", "distance", "segmap", "instance_segmaps", "category_id_segmaps",
    "class_segmaps", "nocs",
)  # fmt: skip
_Three = tuple[float, float, float]


class _Pose(Record, frozen=True, kw_only=True):
    cam2world_matrix: list[list[float]]
    cam_K: tuple[_Three, _Three, _Three]  # noqa: N815  the file's key


def read_hdf5(paths: list[Path]) -> list[Camera]:
    """The camera of each file. Raises CalibrationError."""
    try:
        import h5py  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise CalibrationError(
            f"{paths[0].name} needs h5py", next_step=extras.install_command("hdf5")
        ) from error
    made = []
    for path in paths:
        try:
            with h5py.File(path, "r") as opened:
                file: Any = opened  # its items are groups, arrays or types
                pictures = [file[name].shape for name in _PICTURES if name in file]
                (pose,) = decode(list[_Pose], bytes(file["campose"][()]))
            height, width = next(shape[:2] for shape in pictures if len(shape) in (2, 3))
            made.append(_camera(path.stem, pose, (int(width), int(height))))
        except (OSError, KeyError, TypeError, ValueError, StopIteration, RecordError) as error:
            raise CalibrationError(
                f"{path.name} has no camera",
                found=str(error) or "no picture, which would tell the size",
                expected="campose with cam2world_matrix and cam_K, as BlenderProc's "
                "CameraStateWriter adds them, and a picture such as colors",
                next_step="other files of BlenderProc: write_bop's scene_camera.json is read",
            ) from error
    return made


def _camera(name: str, pose: _Pose, size_wh: tuple[int, int]) -> Camera:
    (fx, _, cx), (_, fy, cy), _ = pose.cam_K
    return Camera(
        name=name,
        world_from_cam=pose_from_opengl(pose.cam2world_matrix),
        size_wh=size_wh,
        fx=fx,
        fy=fy,
        cx=cx + 0.5,
        cy=cy + 0.5,
    )
