"""A camera with a pose: how a scene is seen from anywhere."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.affine import inverse
from legoworld.scene.snapshot import RenderSettings, SceneCamera, Snapshot
from legoworld.visibility.camera import projection
from legoworld.visibility.lens import Lens
from legoworld.visibility.projection import Projection

Row = tuple[float, float, float, float]
Pose = tuple[Row, Row, Row]
_AT_ORIGIN: Final[Pose] = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0))


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Where a picture is taken from, and how its rays become pixels.

    world_from_cam: three rows of a rotation and a position, from OpenCV camera axes (x right,
    y down, z forward) to the scene's world, in scene units. size_wh: pixels. fx, fy: pixels
    (orthographic: pixels per scene unit); cx, cy: pixels, the centre of the first pixel at .5.
    clip: nearest and farthest z that is seen, scene units; None: those of the scene's own camera.
    lens: its distortion, None for a pinhole.
    """

    name: str
    world_from_cam: Pose
    size_wh: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    orthographic: bool = False
    clip: tuple[float, float] | None = None
    lens: Lens | None = None

    @property
    def K(self) -> NDArray[np.float64]:  # noqa: N802  what everybody calls it
        """(3, 3) float64: the intrinsic matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @property
    def cam_from_world(self) -> NDArray[np.float64]:
        """(4, 4) float64: OpenCV camera axes from the world."""
        rotation = np.array(inverse([list(row[:3]) for row in self.world_from_cam]))
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        matrix[:3, 3] = -rotation @ np.array([row[3] for row in self.world_from_cam])
        return matrix

    def anywhere(self) -> Camera:
        """The same camera without its name and pose: equal for equal intrinsics."""
        return replace(self, name="", world_from_cam=_AT_ORIGIN)

    def projection(self, snapshot: Snapshot) -> Projection:
        """Without the pose. snapshot: of the scene, whose own camera clips where this does not."""
        own = snapshot.camera
        near, far = self.clip or (own.clip_start, own.clip_end)
        return Projection(
            orthographic=self.orthographic,
            fx=self.fx,
            fy=self.fy,
            cx=self.cx,
            cy=self.cy,
            z_near=near,
            z_far=far,
        )

    def placed_in(self, snapshot: Snapshot) -> SceneCamera:
        """The camera in Blender's terms; pixels that are not square are left to the projection."""
        width, height = self.size_wh
        own, sensor_mm = snapshot.camera, 36.0
        near, far = self.clip or (own.clip_start, own.clip_end)
        return SceneCamera(
            name=self.name,
            type="ORTHO" if self.orthographic else "PERSP",
            world_from_camera=self.world_from_cam,
            lens_mm=own.lens_mm if self.orthographic else self.fx / width * sensor_mm,
            sensor_width_mm=sensor_mm,
            sensor_height_mm=sensor_mm,
            sensor_fit="HORIZONTAL",
            shift_x=(width / 2 - self.cx) / width,
            shift_y=(self.cy - height / 2) / width,
            ortho_scale=width / self.fx,
            clip_start=near,
            clip_end=far,
        )


def place_scene_camera(
    camera: SceneCamera, render: RenderSettings, size_wh: tuple[int, int]
) -> Camera:
    """A camera of a file at a picture size: what Blender would render with it as the active one."""
    lens = projection(camera, render, size_wh)
    return Camera(
        name=camera.name,
        world_from_cam=cast("Pose", camera.world_from_camera),
        size_wh=size_wh,
        fx=lens.fx,
        fy=lens.fy,
        cx=lens.cx,
        cy=lens.cy,
        orthographic=lens.orthographic,
        clip=(lens.z_near, lens.z_far),
    )
