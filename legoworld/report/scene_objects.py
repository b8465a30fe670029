"""Which object of a scene.glb each pixel of a photo shows, through the camera of the run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import SceneInvalidError
from legoworld.records.report_page import PageScene
from legoworld.report.scene_files import SceneFiles
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.gltf.snapshot import read_glb_snapshot
from legoworld.scene.instances import group
from legoworld.scene.labels import resolve_labels
from legoworld.visibility.posed_camera import Camera
from legoworld.visibility.view import view_through

#: The names of a photo's objects, and the place of each pixel's among them, -1 for none.
Objects = tuple[tuple[str, ...], NDArray[np.int64]]


def scene_objects(
    files: SceneFiles, scene: PageScene | None, size_wh: tuple[int, int]
) -> Objects | None:
    """The objects of a page's scene at a picture size; None where the page has no such scene."""
    if scene is None or scene.glb is None or scene.camera is None:
        return None
    camera = scene.camera
    x, y = (mine / of for mine, of in zip(size_wh, camera.size_wh, strict=True))
    try:
        snapshot = read_glb_snapshot(parse_glb(files.glbs[scene.glb]), Path(), any_camera=True)
        grouping = group(snapshot, resolve_labels(snapshot, (), None, None))
    except SceneInvalidError:  # shown in 3D all the same; nothing of it is named then
        return None
    posed = Camera(
        name="",
        world_from_cam=camera.world_from_cam,  # type: ignore[arg-type]  # three rows of four
        size_wh=size_wh,
        fx=camera.fx * x,
        fy=camera.fy * y,
        cx=camera.cx * x,
        cy=camera.cy * y,
        orthographic=camera.orthographic,
    )
    placed = replace(snapshot, camera=posed.placed_in(snapshot))
    seen = view_through(posed.projection(snapshot), placed, grouping, size_wh)
    names = tuple(instance.name for instance in grouping.instances)
    return names, seen.buffers.instance.astype(np.int64)
