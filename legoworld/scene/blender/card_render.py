"""Rendering an open scene by a card: the evaluator's own picture, and the reference's."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import bpy
import mathutils

from legoworld.conventions import CV_FROM_BLENDER_CAMERA
from legoworld.errors import SceneInvalidError
from legoworld.scene.blender.cameras import refuse_missing_camera
from legoworld.scene.blender.open_file import open_blend
from legoworld.scene.blender.render_state import render_scene, rendered_view_layer
from legoworld.scene.requests import CardRequest, StandRequest

#: Render settings that are not part of the scene; they override the file.
_RENDER: Final[dict[str, Any]] = {
    "engine": "CYCLES",
    "resolution_percentage": 100,
    "pixel_aspect_x": 1.0,
    "pixel_aspect_y": 1.0,
    "film_transparent": False,
    "use_border": False,
    "use_crop_to_border": False,
    "use_compositing": False,
    "use_sequencer": False,
    "use_freestyle": False,
    "use_motion_blur": False,
    "use_multiview": False,
    "use_persistent_data": False,
    "use_single_layer": False,
    "use_stamp": False,  # it would write the machine's name into the picture
    "dither_intensity": 0.0,
    "filepath": "",
}
_CYCLES: Final[dict[str, Any]] = {
    "device": "CPU",
    "shading_system": False,
    "use_animated_seed": False,
    "use_adaptive_sampling": False,
    "use_preview_adaptive_sampling": False,
    "use_denoising": False,
    "use_guiding": False,
    "use_sample_subset": False,
    "sample_offset": 0,
    "sampling_pattern": "TABULATED_SOBOL",
    "auto_scrambling_distance": False,
    "scrambling_distance": 1.0,
    "time_limit": 0.0,
    "pixel_filter_type": "BLACKMAN_HARRIS",
    "filter_width": 1.5,
}


def render_by_card(blend: Path, output: Path, request: CardRequest) -> None:
    """Render a .blend's active camera to an 8-bit RGB PNG.

    request: "size_wh", "samples", "seed", "denoise" and "threads" (0: all). What makes the picture
    is the scene's own: camera, geometry, materials, lights, world, bounces, exposure and view
    transform; the rest is the card's. With "stand" the camera is put elsewhere before. Raises what
    `open_blend` does, NoCameraError, and SceneInvalidError for a scene that Blender refuses to
    render.
    """
    scene = open_by_card(blend, request)
    if "stand" in request:
        _stand(scene, request["stand"])
    _write_png(scene, output)


def open_by_card(blend: Path, request: CardRequest) -> bpy.types.Scene:
    """The scene of a .blend, set up as the card says."""
    scene = open_blend(blend).scene
    refuse_missing_camera(scene)
    render = scene.render
    for name, value in _RENDER.items():
        setattr(render, name, value)
    render.resolution_x, render.resolution_y = request["size_wh"]
    render.threads_mode = "FIXED" if request["threads"] else "AUTO"
    if request["threads"]:
        render.threads = request["threads"]
    for name, value in _CYCLES.items():
        setattr(scene.cycles, name, value)
    scene.cycles.samples, scene.cycles.seed = request["samples"], request["seed"]
    if request["denoise"]:
        scene.cycles.use_denoising = True
        scene.cycles.denoiser = "OPENIMAGEDENOISE"
        scene.cycles.denoising_use_gpu = False
    shown = rendered_view_layer(scene)
    for layer in scene.view_layers:
        layer.use = layer == shown
    return scene


def _stand(scene: bpy.types.Scene, stand: StandRequest) -> None:
    """A copy of a camera at a pose of its own, which nothing in the file moves."""
    bound = [m for m in scene.timeline_markers if m.camera and m.frame <= scene.frame_current]
    holder = max(bound, key=lambda m: m.frame).camera if bound else scene.camera
    if "camera" in stand:
        holder = scene.objects[stand["camera"]]
    data = holder.data.copy()
    data.animation_data_clear()
    data.lens *= stand["zoom"]
    data.ortho_scale /= stand["zoom"]
    data.clip_start, data.clip_end = stand.get("clip", (data.clip_start, data.clip_end))
    copied = bpy.data.objects.new("legoworld stand", data)
    rows = [
        [value * sign for value, sign in zip(row, (*CV_FROM_BLENDER_CAMERA, 1.0), strict=True)]
        for row in stand["world_from_camera"]
    ]
    copied.matrix_world = mathutils.Matrix([*rows, (0.0, 0.0, 0.0, 1.0)])
    scene.collection.objects.link(copied)
    for marker in scene.timeline_markers:
        marker.camera = None
    scene.camera = copied


def _write_png(scene: bpy.types.Scene, output: Path) -> None:
    settings = scene.render.image_settings
    settings.media_type = "IMAGE"
    settings.file_format = "PNG"
    settings.color_mode = "RGB"
    settings.color_depth = "8"
    settings.compression = 15
    settings.color_management = "FOLLOW_SCENE"
    scene.render.filepath = str(output)
    scene.render.use_file_extension = False
    scene.render.use_overwrite = True
    render_scene(scene, write_still=True)
    if not output.is_file():
        raise SceneInvalidError(
            "Blender rendered the scene and left no picture",
            found="no file",
            expected="a PNG of its active camera",
            next_step="render it in Blender and correct what it complains about",
        )
