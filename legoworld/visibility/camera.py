"""A Blender camera and a picture size to a projection: Blender's sensor-fit rule."""

from __future__ import annotations

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
    """Whether the aspect ratio differs from that of the scene's own render.

    One pixel of rounding on either side is not a difference.
    """
    (w, h), (scene_w, scene_h) = size_wh, render.size_wh
    return abs(w * scene_h - h * scene_w) > max(w, h, scene_w, scene_h)
