"""Cameras from what a caller has: poses and intrinsics as arrays, an orbit, a camera file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, TypedDict, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from legoworld.api.arguments import check_argument, check_arguments
from legoworld.camera_files.read import read_camera_file
from legoworld.errors import UsageError
from legoworld.scene.snapshot import RenderSettings, SceneCamera
from legoworld.visibility.posed_camera import Camera, Pose, place_scene_camera

F64 = NDArray[np.float64]
#: How far a rotation may be from one: that of float32, or of a file with six digits.
_ROUNDING: Final = 1e-4
_POSE: Final = "(4, 4) or (3, 4), or n of them; rotation and position of a camera in OpenCV axes"


class CameraOptions(TypedDict, total=False):
    """What cameras are given by as arrays; see `Scene.views`."""

    cam_from_world: ArrayLike | None
    world_from_cam: ArrayLike | None
    K: ArrayLike | None
    fov_deg: float | None
    ortho_scale: float | None
    clip: tuple[float, float] | None


#: A camera of the file by its name or as a value, or any other.
AnyCamera = str | SceneCamera | Camera


def named_cameras(
    cameras: Iterable[AnyCamera],
    known: Mapping[str, SceneCamera],
    render: RenderSettings,
    size_wh: tuple[int, int] | None,
) -> list[Camera]:
    """Cameras of a file, by name, and others as they are. UsageError for an unknown name."""
    made = []
    for camera in cameras:
        if isinstance(camera, str):
            if camera not in known:
                raise UsageError(
                    f"the scene has no camera {camera!r}",
                    expected=", ".join(map(repr, known)),
                    next_step="one that is panoramic, excluded or hidden from rendering is not "
                    "read: change it, or pass its pose",
                )
            camera = known[camera]
        if isinstance(camera, SceneCamera):
            made.append(place_scene_camera(camera, render, size_wh or render.size_wh))
        elif isinstance(camera, Camera):
            made.append(camera)
        else:
            raise UsageError(
                "that is no camera",
                found=repr(camera)[:100],
                expected="a name, or a legoworld.Camera",
            )
    return made


def posed_cameras(
    size_wh: tuple[int, int],
    lens: Camera,
    *,
    cam_from_world: ArrayLike | None = None,
    world_from_cam: ArrayLike | None = None,
    K: ArrayLike | None = None,  # noqa: N803
    fov_deg: float | None = None,
    ortho_scale: float | None = None,
    clip: tuple[float, float] | None = None,
) -> list[Camera]:
    """A camera for each pose. lens: whose intrinsics they have where none are given.

    Raises UsageError for what is no pose or no intrinsics.
    """
    if (cam_from_world is None) == (world_from_cam is None):
        raise UsageError(
            "a pose is given in one direction",
            found="none" if cam_from_world is None else "cam_from_world and world_from_cam",
            expected="cam_from_world (extrinsics) or world_from_cam (camera to world)",
        )
    if world_from_cam is not None:
        poses = _poses("world_from_cam", world_from_cam)
    else:
        assert cam_from_world is not None
        poses = _poses("cam_from_world", cam_from_world)
        rotation = poses[:, :, :3].transpose(0, 2, 1)
        position = -np.einsum("nij,nj->ni", rotation, poses[:, :, 3])
        poses = np.concatenate([rotation, position[:, :, None]], axis=2)
    intrinsics = _intrinsics(size_wh, lens, len(poses), K, fov_deg, ortho_scale)
    own_lens = K is None and fov_deg is None and ortho_scale is None
    return [
        Camera(
            name=f"view {number}",
            world_from_cam=_rows(pose),
            size_wh=size_wh,
            fx=fx,
            fy=fy,
            cx=cx,
            cy=cy,
            orthographic=lens.orthographic if own_lens else ortho_scale is not None,
            clip=clip or lens.clip,
        )
        for number, (pose, (fx, fy, cx, cy)) in enumerate(zip(poses, intrinsics, strict=True))
    ]


@check_arguments
def orbit(
    *,
    centre: Sequence[float],
    radius: float,
    n: int,
    elevation_deg: float = 20.0,
    fov_deg: float = 50.0,
    size_wh: tuple[int, int] = (640, 480),
) -> list[Camera]:
    """Cameras on a circle around a point, evenly spaced, that look at it; z is up.

    centre: x, y, z in scene units; radius: distance to it. elevation_deg: above the horizon,
    within (-90, 90). fov_deg: horizontal field of view. The first looks along +y.
    """
    target = _numbers("centre", centre, (3,))
    angles = np.arange(n) * (2 * np.pi / n) - np.pi / 2
    up = math.radians(elevation_deg)
    away = np.stack([np.cos(angles), np.sin(angles), np.full(n, math.tan(up))], axis=1)
    away *= math.cos(up)
    forward, right = -away, np.stack([-np.sin(angles), np.cos(angles), np.zeros(n)], axis=1)
    down = np.cross(forward, right)
    poses = np.stack([right, down, forward, target + radius * away], axis=2)
    (fx, fy, cx, cy), *_ = _from_fov(size_wh, fov_deg, 1)
    return [
        Camera(name=f"orbit {i}", world_from_cam=_rows(pose), size_wh=size_wh,
               fx=fx, fy=fy, cx=cx, cy=cy)
        for i, pose in enumerate(poses)
    ]  # fmt: skip


def read_cameras(path: str | Path) -> list[Camera]:
    """The cameras of a file, by their photos' names, in the file's order.

    path: COLMAP's folder (cameras.txt, images.txt or .bin; ETH3D's dslr_calibration_*),
    nerfstudio's or NeRF's transforms.json, scene_camera.json as BlenderProc and BOP write it,
    beside or above its camera.json, or BlenderProc's .hdf5 with `campose`, or a folder of them
    (needs h5py). Their conventions are converted: OpenCV axes, pixel centres at
    .5, lens distortion where the file has one. Positions are in the file's own world and unit,
    millimetres of BOP as metres. Raises CalibrationError.
    """
    check_argument("folder", path)
    return read_camera_file(Path(path))


def _numbers(name: str, value: ArrayLike, shape: tuple[int, ...]) -> F64:
    """An array of finite numbers of a shape, whose leading axes may be absent."""
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise UsageError(
            f"the argument {name} cannot be used", found=repr(value)[:100], expected="numbers"
        ) from error
    if array.shape != shape or not np.isfinite(array).all():
        raise UsageError(
            f"the argument {name} cannot be used",
            found=f"shape {array.shape}" if array.shape != shape else "NaN or infinity",
            expected=f"finite numbers of shape {shape}",
        )
    return array


def _poses(name: str, value: ArrayLike) -> F64:
    """(n, 3, 4) poses. UsageError for matrices that are not rigid."""
    shape = np.shape(value)
    if len(shape) not in (2, 3) or shape[-2:] not in ((4, 4), (3, 4)) or not all(shape):
        raise UsageError(
            f"the argument {name} cannot be used", found=f"shape {shape}", expected=_POSE
        )
    poses = _numbers(name, value, shape).reshape(-1, *shape[-2:])
    rotation = poses[:, :3, :3]
    skew = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = (skew > _ROUNDING) | (np.linalg.det(rotation) < 0)
    if shape[-2] == 4:
        wrong |= (poses[:, 3] != (0, 0, 0, 1)).any(axis=1)
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        raise UsageError(
            f"{name} holds a matrix that is no pose",
            found=f"number {first}: {poses[first].tolist()}"[:200],
            expected="a rotation (right-handed, without scale) and a position, last row 0 0 0 1",
            next_step="OpenGL and Blender cameras (y up, z backwards) need "
            "world_from_cam @ diag(1, -1, -1, 1)",
        )
    return poses[:, :3]


def _rows(pose: F64) -> Pose:
    return cast("Pose", tuple(map(tuple, pose.tolist())))


def _intrinsics(
    size_wh: tuple[int, int],
    lens: Camera,
    count: int,
    K: ArrayLike | None,  # noqa: N803
    fov_deg: float | None,
    ortho_scale: float | None,
) -> list[tuple[float, float, float, float]]:
    """fx, fy, cx, cy of each camera."""
    if sum(one is not None for one in (K, fov_deg, ortho_scale)) > 1:
        raise UsageError("intrinsics are given once", expected="K, fov_deg or ortho_scale")
    if K is None:
        if fov_deg is not None:
            return _from_fov(size_wh, fov_deg, count)
        if ortho_scale is None:
            return [(lens.fx, lens.fy, lens.cx, lens.cy)] * count
        scale = max(size_wh) / ortho_scale
        return [(scale, scale, size_wh[0] / 2, size_wh[1] / 2)] * count
    shape = np.shape(K)
    if shape not in ((3, 3), (count, 3, 3)):
        raise UsageError(
            "the argument K cannot be used",
            found=f"shape {shape}",
            expected=f"(3, 3) or ({count}, 3, 3)",
        )
    matrices = np.broadcast_to(_numbers("K", K, shape), (count, 3, 3))
    one = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 1]], bool)
    if (matrices[:, ~one] != 0).any() or (matrices[:, 2, 2] != 1).any():
        raise UsageError(
            "K is not that of a pinhole without skew",
            found=str(matrices[0].tolist())[:200],
            expected="[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]",
        )
    if (matrices[:, (0, 1), (0, 1)] <= 0).any():
        raise UsageError("K has a focal length of 0 or less", found=str(matrices[0].tolist())[:99])
    fx_fy_cx_cy = matrices[:, (0, 1, 0, 1), (0, 1, 2, 2)].tolist()
    return [(fx, fy, cx, cy) for fx, fy, cx, cy in fx_fy_cx_cy]


def _from_fov(
    size_wh: tuple[int, int], fov_deg: float, count: int
) -> list[tuple[float, float, float, float]]:
    width, height = size_wh
    focal = width / 2 / math.tan(math.radians(fov_deg) / 2)
    return [(focal, focal, width / 2, height / 2)] * count
