"""glTF cameras in Blender's terms.

glTF gives a vertical field of view and an aspect ratio, Blender the field of view of the longer
side of the picture. With aspectRatio >= 1 the horizontal field of view is kept, otherwise the
vertical one; the result is fitted to a picture by Blender's AUTO rule, so that a picture of another
aspect is what Blender would render. Without aspectRatio the vertical field of view is kept in any
picture.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import CV_FROM_BLENDER_CAMERA
from legoworld.errors import NoCameraError, NonFiniteGeometryError, UnsupportedCameraError
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.nodes import BLENDER_FROM_GLTF, Node, Tree
from legoworld.scene.snapshot import SceneCamera

_SENSOR_MM: Final = 36.0  # Blender's default; only lens / sensor enters the projection
#: Half a picture at distance 1 must lie in this range for the kernel to be able to project it.
_SMALLEST, _LARGEST = 1e-6, 1e6
_FAR: Final = 1e30  # stands for glTF's infinite projection
_SHORT_SIDE_PX: Final = 1080
_LONGEST_SIDE_PX: Final = 8192

#: Blender's new camera, at the origin.
_DEFAULT: Final = SceneCamera(
    name="Camera",
    type="PERSP",
    world_from_camera=((1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0)),
    lens_mm=50.0,
    sensor_width_mm=36.0,
    sensor_height_mm=24.0,
    sensor_fit="AUTO",
    shift_x=0.0,
    shift_y=0.0,
    ortho_scale=6.0,
    clip_start=0.1,
    clip_end=1000.0,
)

_Pose = tuple[tuple[float, float, float, float], ...]


def scene_camera(
    document: Fields, tree: Tree, *, any_camera: bool = False
) -> tuple[SceneCamera, float | None, tuple[str, ...]]:
    """The scene's first camera in the file's order, its aspect ratio, and warnings.

    any_camera: a default one where the scene has none. glTF does not mark a camera as the active
    one. Raises NoCameraError, UnsupportedCameraError or NonFiniteGeometryError.
    """
    holders = [node for node in tree.nodes if node.camera >= 0]
    if not holders and any_camera:
        return _DEFAULT, None, ()
    if not holders:
        raise NoCameraError(
            "scene.glb has no camera",
            found="no node of its scene holds one",
            expected="a camera that matches the photo",
            next_step="export with cameras, or use --source blend",
        )
    warnings: tuple[str, ...] = ()
    if len(holders) > 1:
        names = ", ".join(repr(node.name) for node in holders[1:6])
        warnings = (
            f"scene.glb holds {len(holders)} cameras and glTF marks none as active; "
            f"read: {holders[0].name!r}, not {names}",
        )
    return *_node_camera(document, tree, holders[0]), warnings


def scene_cameras(document: Fields, tree: Tree) -> tuple[SceneCamera, ...]:
    """Every camera of the scene by its node's name, without those that cannot be read."""
    cameras: dict[str, SceneCamera] = {}
    for node in sorted(tree.nodes, key=lambda node: (node.name, node.index)):
        if node.camera >= 0 and node.name not in cameras:
            with suppress(UnsupportedCameraError, NonFiniteGeometryError):
                cameras[node.name] = _node_camera(document, tree, node)[0]
    return tuple(cameras.values())


def _node_camera(document: Fields, tree: Tree, node: Node) -> tuple[SceneCamera, float | None]:
    pose = _rigid_pose(node, BLENDER_FROM_GLTF @ tree.world_from_node[node.index])
    camera = document.children("cameras")[node.camera]
    kind = camera.text("type")
    if kind == "perspective":
        return _perspective(camera.child(kind), node.name, pose)
    if kind == "orthographic":
        return _orthographic(camera.child(kind), node.name, pose)
    raise UnsupportedCameraError(
        f"camera {node.name!r} cannot be read out",
        found=f"camera type {kind!r}",
        expected="perspective or orthographic",
        next_step="use a perspective camera that matches the photo",
    )


def picture_size_wh(aspect: float | None) -> tuple[int, int]:
    """A picture of the camera's aspect whose shorter side is 1080: glTF records no size."""
    if aspect is None:
        return 1920, 1080
    longer = min(round(_SHORT_SIDE_PX * max(aspect, 1 / aspect)), _LONGEST_SIDE_PX)
    shorter = max(1, min(_SHORT_SIDE_PX, round(longer / max(aspect, 1 / aspect))))
    return (longer, shorter) if aspect >= 1 else (shorter, longer)


def _perspective(lens: Fields, name: str, pose: _Pose) -> tuple[SceneCamera, float | None]:
    yfov, near = lens.number("yfov"), lens.number("znear")
    far = lens.number("zfar", _FAR)
    aspect = lens.number("aspectRatio") if "aspectRatio" in lens else None
    if not 0 < yfov < math.pi or near <= 0 or (aspect is not None and aspect <= 0):
        raise _unsupported_error(name, f"yfov {yfov}, znear {near}, aspectRatio {aspect}")
    half = math.tan(yfov / 2)
    if aspect is not None and aspect >= 1:
        half *= aspect
    fit: Literal["AUTO", "VERTICAL"] = "VERTICAL" if aspect is None else "AUTO"
    if not _SMALLEST <= half <= _LARGEST:
        raise _unsupported_error(name, f"a field of view of tangent {half:g}")
    camera = _camera(name, "PERSP", pose, fit=fit, near=near, far=far, half_sensor_at_1=half)
    return camera, _sound_aspect(aspect)


def _orthographic(lens: Fields, name: str, pose: _Pose) -> tuple[SceneCamera, float | None]:
    x, y = lens.number("xmag"), lens.number("ymag")
    near, far = lens.number("znear"), lens.number("zfar")
    if not (x > 0 and y > 0 and _SMALLEST <= max(x, y) <= _LARGEST):
        raise _unsupported_error(name, f"xmag {x}, ymag {y}")
    camera = _camera(name, "ORTHO", pose, fit="AUTO", near=near, far=far, ortho_scale=2 * max(x, y))
    return camera, _sound_aspect(x / y)


def _sound_aspect(aspect: float | None) -> float | None:
    """The aspect ratio where a picture can have it."""
    return aspect if aspect and 1 / _LONGEST_SIDE_PX <= aspect <= _LONGEST_SIDE_PX else None


def _camera(
    name: str,
    kind: Literal["PERSP", "ORTHO"],
    pose: _Pose,
    *,
    fit: Literal["AUTO", "VERTICAL"],
    near: float,
    far: float,
    half_sensor_at_1: float = 0.5,
    ortho_scale: float = 1.0,
) -> SceneCamera:
    if not near < far <= _FAR:
        raise _unsupported_error(name, f"znear {near}, zfar {far}")
    return SceneCamera(
        name=name,
        type=kind,
        world_from_camera=pose,
        lens_mm=_SENSOR_MM / 2 / half_sensor_at_1,
        sensor_width_mm=_SENSOR_MM,
        sensor_height_mm=_SENSOR_MM,
        sensor_fit=fit,
        shift_x=0.0,
        shift_y=0.0,
        ortho_scale=ortho_scale,
        clip_start=near,
        clip_end=far,
    )


def _rigid_pose(node: Node, world_from_camera: NDArray[np.float64]) -> _Pose:
    """The pose in OpenCV axes, each axis at length 1, as `scene.blender.extract` removes scale."""
    axes = world_from_camera[:3, :3]
    with np.errstate(all="ignore"):
        axes = axes / np.linalg.norm(axes, axis=0)
        volume = abs(np.linalg.det(axes))
    if not volume > _SMALLEST:
        raise NonFiniteGeometryError(
            f"camera node {node.name!r} is broken",
            found="its axes do not span space",
            expected="a rotation, perhaps with a scale",
            next_step="correct the camera's transform",
        )
    rows = np.column_stack([axes * np.array(CV_FROM_BLENDER_CAMERA), world_from_camera[:3, 3]])
    return cast("_Pose", tuple(tuple(row) for row in rows.tolist()))


def _unsupported_error(name: str, found: str) -> UnsupportedCameraError:
    return UnsupportedCameraError(
        f"camera {name!r} cannot be read out",
        found=found,
        expected="0 < yfov < pi, 0 < znear < zfar, aspectRatio, xmag and ymag above 0",
        next_step="correct the camera's settings",
    )
