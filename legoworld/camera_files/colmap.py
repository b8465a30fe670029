"""COLMAP's models: cam_from_world quaternions, pixel centres at .5, OpenCV axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from legoworld.scene.affine import inverse
from legoworld.tracks import colmap
from legoworld.tracks.colmap import CalibrationError, read_calibration
from legoworld.visibility.lens import Lens
from legoworld.visibility.posed_camera import Camera, Pose

#: How many focal lengths a model has, which coefficients follow cx and cy, whether it is a fisheye.
_MODELS: Final[dict[str, tuple[int, tuple[str, ...], bool]]] = {
    "SIMPLE_PINHOLE": (1, (), False),
    "PINHOLE": (2, (), False),
    "SIMPLE_RADIAL": (1, ("k1",), False),
    "RADIAL": (1, ("k1", "k2"), False),
    "OPENCV": (2, ("k1", "k2", "p1", "p2"), False),
    "SIMPLE_RADIAL_FISHEYE": (1, ("k1",), True),
    "RADIAL_FISHEYE": (1, ("k1", "k2"), True),
    "OPENCV_FISHEYE": (2, ("k1", "k2", "k3", "k4"), True),
    "THIN_PRISM_FISHEYE": (2, ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"), True),
}
_ORDER: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1")


def read_colmap(folder: Path) -> list[Camera]:
    """The photos of a model's folder, in the file's order. Raises CalibrationError."""
    calibration = read_calibration(folder)
    if not calibration.poses:
        raise CalibrationError(
            f"{folder.name} has no photo with a pose",
            found="cameras without images.txt",
            expected="cameras.txt and images.txt, or cameras.bin and images.bin",
        )
    made = []
    for name, pose in calibration.poses.items():
        camera = calibration.cameras.get(calibration.camera_ids[name])
        if camera is None:
            raise CalibrationError(
                f"photo {name!r} is of a camera that the file lacks",
                found=f"camera {calibration.camera_ids[name]}",
                expected=", ".join(map(str, calibration.cameras)),
            )
        made.append(_camera(name, camera, world_from_cam(pose, name)))
    return made


def _camera(name: str, camera: colmap.Camera, pose: Pose) -> Camera:
    n_focal, names, fisheye = _MODELS.get(camera.model, (0, (), False))
    if not n_focal or len(camera.params) != n_focal + 2 + len(names):
        raise CalibrationError(
            f"the camera of {name!r} has a model that is not read",
            found=f"{camera.model} with {len(camera.params)} parameters",
            expected=", ".join(_MODELS),
            next_step="undistort the photos with COLMAP: its PINHOLE model is read",
        )
    fx, fy = camera.params[0], camera.params[n_focal - 1]
    cx, cy, *coefficients = camera.params[n_focal:]
    return Camera(
        name=name,
        world_from_cam=pose,
        size_wh=camera.size_wh,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        lens=make_lens(dict(zip(names, coefficients, strict=True)), fisheye=fisheye),
    )


def make_lens(coefficients: Mapping[str, float], *, fisheye: bool) -> Lens | None:
    """A lens of coefficients by name; None for one that distorts nothing."""
    if not fisheye and not any(coefficients.values()):
        return None
    k1, k2, p1, p2, k3, k4, sx1, sy1 = (coefficients.get(name, 0.0) for name in _ORDER)
    return Lens(coefficients=(k1, k2, p1, p2, k3, k4, sx1, sy1), fisheye=fisheye)


def world_from_cam(pose: tuple[float, ...], name: str) -> Pose:
    """The inverse of cam_from_world as QW QX QY QZ TX TY TZ; the quaternion is normalised.

    Raises CalibrationError for a quaternion of length 0.
    """
    length = math.sqrt(sum(q * q for q in pose[:4]))
    if not length > 0:
        raise CalibrationError(
            f"photo {name!r} has no rotation", found=str(pose[:4]), expected="a unit quaternion"
        )
    w, x, y, z = (q / length for q in pose[:4])
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return invert_pose(rotation, pose[4:])


def invert_pose(rotation: list[list[float]], translation: tuple[float, ...]) -> Pose:
    """The pose whose inverse has this rotation and translation."""
    a, b, c = (
        (*row, -sum(r * t for r, t in zip(row, translation, strict=True)))
        for row in inverse(rotation)
    )
    return (_row(a), _row(b), _row(c))


def _row(values: tuple[float, ...]) -> tuple[float, float, float, float]:
    x, y, z, w = values
    return x, y, z, w
