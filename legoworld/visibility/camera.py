"""A Blender camera and a picture size to a projection: Blender's sensor-fit rule."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.snapshot import RenderSettings, SceneCamera
from legoworld.visibility.projection import Projection


def projection(camera: SceneCamera, render: RenderSettings, size_wh: tuple[int, int]) -> Projection:
    """What Blender would render with its resolution set to `size_wh` at 100 %.

    Agrees with `bpy.types.Object.calc_matrix_camera` (BKE_camera_params_compute_viewplane): the
    sensor spans the picture's longer side in AUTO, lengths are measured in pixels of that side,
    and a pixel is `pixel_aspect_y / pixel_aspect_x` times as high as wide.
    """
    width, height = size_wh
    pixel_height = render.pixel_aspect_y / render.pixel_aspect_x
    horizontal = camera.sensor_fit == "HORIZONTAL" or (
        camera.sensor_fit == "AUTO"
        and render.pixel_aspect_x * width >= render.pixel_aspect_y * height
    )
    fitted = width if horizontal else height * pixel_height
    if camera.type == "ORTHO":
        fx = fitted / camera.ortho_scale
    else:
        vertical_sensor = camera.sensor_fit == "VERTICAL"
        sensor = camera.sensor_height_mm if vertical_sensor else camera.sensor_width_mm
        fx = camera.lens_mm / sensor * fitted
    return Projection(
        orthographic=camera.type == "ORTHO",
        fx=fx,
        fy=fx / pixel_height,
        cx=width / 2 - camera.shift_x * fitted,
        cy=height / 2 + camera.shift_y * fitted / pixel_height,
        z_near=camera.clip_start,
        z_far=camera.clip_end,
    )


def aspect_differs(render: RenderSettings, size_wh: tuple[int, int]) -> bool:
    """Whether the picture's sides are in another proportion than the scene's own picture.

    One pixel of rounding on either side is not a difference.
    """
    (w, h), (scene_w, scene_h) = size_wh, render.size_wh
    return abs(w * scene_h - h * scene_w) > max(w, h, scene_w, scene_h)


def cam_from_mesh(camera: SceneCamera, world_from_mesh: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S, 3, 4) float64 camera-from-mesh transforms of (S, 3, 4) placements."""
    # Products are written out: BLAS rounds differently from CPU to CPU, and the same scene must
    # give the same bytes on all.
    rotation = [list(row[:3]) for row in camera.world_from_camera]
    origin = np.array([row[3] for row in camera.world_from_camera], np.float64)
    result = np.empty_like(world_from_mesh)
    offset = world_from_mesh[:, :, 3] - origin
    for row, (x, y, z) in enumerate(_inverse(rotation)):
        result[:, row, 3] = x * offset[:, 0] + y * offset[:, 1] + z * offset[:, 2]
        for column in range(3):
            axis = world_from_mesh[:, :, column]
            result[:, row, column] = x * axis[:, 0] + y * axis[:, 1] + z * axis[:, 2]
    return result


def _inverse(m: list[list[float]]) -> list[list[float]]:
    """The inverse of a 3 x 3 matrix by its cofactors, in plain float64."""
    cofactors = [
        [
            m[(r + 1) % 3][(c + 1) % 3] * m[(r + 2) % 3][(c + 2) % 3]
            - m[(r + 1) % 3][(c + 2) % 3] * m[(r + 2) % 3][(c + 1) % 3]
            for c in range(3)
        ]
        for r in range(3)
    ]
    determinant = sum(m[0][c] * cofactors[0][c] for c in range(3))
    return [[cofactors[c][r] / determinant for c in range(3)] for r in range(3)]
