"""An open .blend to a Snapshot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import NoMeshError
from legoworld.scene.blender.alpha_table import AlphaTable, Cut
from legoworld.scene.blender.cameras import (
    add_missing_camera,
    refuse_missing_camera,
    scene_camera,
    scene_cameras,
)
from legoworld.scene.blender.meshes import CopiedMesh
from legoworld.scene.blender.occurrences import Walk, walk
from legoworld.scene.blender.open_file import OpenFile, open_blend
from legoworld.scene.blender.placements import resolve_placements
from legoworld.scene.blender.render_state import rendered_view_layer, visit_render_state
from legoworld.scene.blender.tree import scene_tree
from legoworld.scene.snapshot import Cutout, RenderSettings, SceneCamera, Snapshot
from legoworld.scene.triangle_cuts import cut_arrays

if TYPE_CHECKING:
    import bpy


def read_blend_snapshot(
    path: Path, *, any_camera: bool = False, corner_normals: bool = False
) -> Snapshot:
    """Open a .blend and copy its render state. Raises the SceneInvalidErrors of `errors`.

    any_camera: give a scene without an active camera one of Blender's default settings.
    """
    opened = open_blend(path)
    if any_camera:
        add_missing_camera(opened.scene)
    return read_open_snapshot(opened, corner_normals=corner_normals)


def read_open_snapshot(open_file: OpenFile, *, corner_normals: bool = False) -> Snapshot:
    """`read_blend_snapshot` of a file that is open. Changes its render settings."""
    scene, warnings = open_file.scene, open_file.warnings
    if open_file.n_scenes > 1:
        warnings.append(f"the file holds {open_file.n_scenes} scenes; read: {scene.name!r}")
    render = _render_settings(scene)
    layers = [layer.name for layer in scene.view_layers if layer.use]
    if len(layers) > 1:
        warnings.append(f"the scene renders {len(layers)} view layers; read: {render.view_layer!r}")
    if not rendered_view_layer(scene).use_solid:
        warnings.append(f"view layer {render.view_layer!r} renders no surfaces: read with them")
    refuse_missing_camera(scene)
    copied: list[tuple[Walk, tuple[SceneCamera, ...]]] = []

    def copy(graph: bpy.types.Depsgraph) -> None:
        seen_by = scene_camera(graph.scene_eval)
        copied.append(
            (walk(graph, seen_by, corner_normals=corner_normals), (seen_by, *scene_cameras(graph)))
        )

    visit_render_state(scene, copy)
    walked, cameras = copied[0]
    return _assemble(walked, cameras, render, scene, warnings, corner_normals=corner_normals)


def _assemble(
    walk: Walk,
    cameras: tuple[SceneCamera, ...],
    render: RenderSettings,
    scene: bpy.types.Scene,
    warnings: list[str],
    *,
    corner_normals: bool,
) -> Snapshot:
    if not walk.meshes:
        raise NoMeshError(
            "nothing in the scene renders as a surface",
            found=f"{len(scene.objects)} objects, none with a visible face",
            expected="at least one mesh that is not hidden from rendering",
            next_step="check hide_render, collection exclusion and material alpha",
        )
    met = {s.object for s in walk.graph_entries} | {s.top for s in walk.graph_entries}
    objects, collections, object_index = scene_tree(scene, met, walk.warnings)
    placements = resolve_placements(walk.graph_entries, walk.generators, object_index)
    meshes = [walk.meshes[i] for i in placements.mesh_order]
    arrays: dict[str, Any] = dict(placements.arrays)
    return Snapshot(
        objects=objects,
        collections=collections,
        camera=cameras[0],
        cameras=cameras[1:],
        for_camera=walk.for_camera,
        render=render,
        warnings=(*warnings, *sorted(walk.warnings)),
        vertices=np.concatenate([m.vertices for m in meshes]),
        triangles=np.concatenate([m.triangles for m in meshes]),
        vertex_start=np.cumsum([0] + [len(m.vertices) for m in meshes], dtype=np.int64),
        triangle_start=np.cumsum([0] + [len(m.triangles) for m in meshes], dtype=np.int64),
        **arrays,
        **_cutouts(walk.alphas, meshes),
        corner_normal=np.concatenate([_mesh_normals(m) for m in meshes])
        if corner_normals
        else None,
    )


def _mesh_normals(mesh: CopiedMesh) -> NDArray[np.float32]:
    if mesh.corner_normal is None:
        return np.zeros((len(mesh.triangles), 3, 3), np.float32)
    return mesh.corner_normal


def _cutouts(alphas: AlphaTable, meshes: list[CopiedMesh]) -> dict[str, Any]:
    """The cut-out fields of a Snapshot, cuts in an order that only their content decides."""
    if all(mesh.cuts is None for mesh in meshes):
        return {}
    used = np.unique(np.concatenate([m.cuts.cut for m in meshes if m.cuts is not None]))
    order = sorted((int(i) for i in used if i >= 0), key=alphas.sort_key)
    number = np.full(len(alphas.cuts) + 1, -1, np.int32)  # the last one: -1 stays -1
    number[order] = np.arange(len(order), dtype=np.int32)
    arrays = cut_arrays([(mesh.cuts, len(mesh.triangles)) for mesh in meshes])
    return {
        **arrays,
        "cutouts": tuple(_cutout(alphas.cuts[i]) for i in order),
        "cutout_alphas": tuple(alphas.pictures[i] for i in order),
        "triangle_cutout": number[arrays["triangle_cutout"]],
    }


def _cutout(cut: Cut) -> Cutout:
    if cut.image is None:
        return Cutout(name="", wrap="extend", interpolation="closest", sides=cut.sides)
    source = cut.image.source
    return Cutout(
        name=source.image, wrap=source.wrap, interpolation=source.interpolation, sides=cut.sides
    )


def _render_settings(scene: bpy.types.Scene) -> RenderSettings:
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
        view_layer=rendered_view_layer(scene).name,
    )
