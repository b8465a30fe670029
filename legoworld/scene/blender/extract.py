"""An open .blend to a Snapshot."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

import bpy
import numpy as np
from mathutils import Matrix

from legoworld.conventions import CV_FROM_BLENDER_CAMERA
from legoworld.errors import (
    NoCameraError,
    NoMeshError,
    NonFiniteGeometryError,
    UnsupportedCameraError,
)
from legoworld.scene.blender.opening import open_blend
from legoworld.scene.blender.render_state import rendered_view_layer, visit_render_state
from legoworld.scene.blender.tree import occurrence_arrays, scene_tree
from legoworld.scene.blender.occurrences import Walk, walk
from legoworld.scene.snapshot import Cutout, RenderSettings, SceneCamera, Snapshot


def snapshot_of_blend(path: Path) -> Snapshot:
    """Open a .blend and copy its render state. Raises the SceneInvalidErrors of `errors`."""
    warnings = open_blend(path)
    scene = bpy.context.scene
    if len(bpy.data.scenes) > 1:
        local = [s.name for s in bpy.data.scenes if s.library is None]
        if len(local) > 1:
            warnings.append(f"the file holds {len(local)} scenes; read: {scene.name!r}")
    render = _render_settings(scene)
    if scene.camera is None and not any(m.camera for m in scene.timeline_markers):
        cameras = sorted(o.name for o in scene.objects if o.type == "CAMERA")
        raise NoCameraError(
            "the scene has no active camera",
            found=f"{len(cameras)} camera objects, none active: {', '.join(cameras[:5])}"
            if cameras
            else "no camera object",
            expected="scene.camera set to the camera that matches the photo",
            next_step="set bpy.context.scene.camera in the scene program",
        )
    copied: list[tuple[Walk, SceneCamera]] = []
    visit_render_state(lambda graph: copied.append((walk(graph), _camera(graph.scene_eval))))
    walked, camera = copied[0]
    return _assemble(walked, camera, render, scene, warnings)


def _assemble(
    walked: Walk, camera: SceneCamera, render: RenderSettings, scene: Any, warnings: list[str]
) -> Snapshot:
    if not any(seen.mesh >= 0 for seen in walked.seen):
        raise NoMeshError(
            "nothing in the scene renders as a surface",
            found=f"{len(scene.objects)} objects, none with a visible face",
            expected="at least one mesh that is not hidden from rendering",
            next_step="check hide_render, collection exclusion and material alpha",
        )
    objects, collections, object_index = scene_tree(scene, walked.seen)
    occurrences, mesh_order = occurrence_arrays(walked.seen, objects, object_index)
    meshes = [walked.meshes[i] for i in mesh_order]
    cutouts: dict[str, Any] = {}
    if walked.alphas.images:
        cutouts = _cutouts(walked, mesh_order)
    return Snapshot(
        objects=objects,
        collections=collections,
        camera=camera,
        render=render,
        warnings=tuple(warnings) + tuple(sorted(walked.warnings)),
        vertices=np.concatenate([m.vertices for m in meshes]),
        triangles=np.concatenate([m.triangles for m in meshes]),
        vertex_start=np.cumsum([0] + [len(m.vertices) for m in meshes], dtype=np.int64),
        triangle_start=np.cumsum([0] + [len(m.triangles) for m in meshes], dtype=np.int64),
        **occurrences,
        **cutouts,
    )


def _cutouts(walked: Walk, mesh_order: list[int]) -> dict[str, Any]:
    triangle_cutout, uv = [], []
    for i in mesh_order:
        n_triangles = len(walked.meshes[i].triangles)
        per_mesh = walked.mesh_cutouts[i] or (
            np.full(n_triangles, -1, np.int32),
            np.zeros((n_triangles, 3, 2), np.float32),
        )
        triangle_cutout.append(per_mesh[0])
        uv.append(per_mesh[1])
    return {
        "cutouts": tuple(
            Cutout(name=a.image, wrap=a.wrap, interpolation=a.interpolation)
            for a in walked.alphas.images
        ),
        "cutout_alphas": tuple(walked.alphas.pictures),
        "triangle_cutout": np.concatenate(triangle_cutout),
        "corner_uv": np.concatenate(uv),
    }


def _render_settings(scene: Any) -> RenderSettings:
    render, units = scene.render, scene.unit_settings
    return RenderSettings(
        resolution_x=render.resolution_x,
        resolution_y=render.resolution_y,
        resolution_percentage=render.resolution_percentage,
        pixel_aspect_x=render.pixel_aspect_x,
        pixel_aspect_y=render.pixel_aspect_y,
        use_border=render.use_border,
        frame=scene.frame_current,
        subframe=scene.frame_subframe,
        unit_system=units.system,
        unit_scale=units.scale_length,
        scene_name=scene.name,
        view_layer=rendered_view_layer().name,
    )


def _camera(scene: Any) -> SceneCamera:
    camera_object = scene.camera
    if camera_object is None or camera_object.type != "CAMERA":
        kind = "nothing" if camera_object is None else f"a {camera_object.type.lower()} object"
        raise NoCameraError(
            "the scene's active camera is not a camera",
            found=kind,
            expected="a camera object",
            next_step="set bpy.context.scene.camera in the scene program",
        )
    camera = camera_object.data
    if camera.type not in ("PERSP", "ORTHO"):
        raise UnsupportedCameraError(
            f"camera {camera_object.name!r} cannot be read out",
            found=f"camera type {camera.type}",
            expected="PERSP or ORTHO",
            next_step="use a perspective camera that matches the photo",
        )
    pose = _rigid_pose(camera_object.matrix_world)
    numbers = {
        "lens_mm": camera.lens,
        "sensor_width_mm": camera.sensor_width,
        "sensor_height_mm": camera.sensor_height,
        "shift_x": camera.shift_x,
        "shift_y": camera.shift_y,
        "ortho_scale": camera.ortho_scale,
        "clip_start": camera.clip_start,
        "clip_end": camera.clip_end,
    }
    flat = [*numbers.values(), *(x for row in pose for x in row)]
    if not all(math.isfinite(x) for x in flat):
        raise NonFiniteGeometryError(
            f"camera {camera_object.name!r} is broken",
            found="NaN or infinity in its matrix or settings",
            expected="finite numbers",
            next_step="correct the camera's transform and lens",
        )
    return SceneCamera(
        name=camera_object.original.name,
        type=camera.type,
        world_from_camera=pose,
        sensor_fit=camera.sensor_fit,
        **numbers,
    )


def _rigid_pose(world_from_object: Any) -> tuple[tuple[float, float, float, float], ...]:
    """The camera's pose in OpenCV axes, scale and shear removed as a Blender render removes them."""
    rigid: Matrix = world_from_object.normalized()
    return cast(
        "tuple[tuple[float, float, float, float], ...]",
        tuple(
            tuple(float(rigid[r][c]) * CV_FROM_BLENDER_CAMERA[c] for c in range(3))
            + (float(rigid[r][3]),)
            for r in range(3)
        ),
    )
