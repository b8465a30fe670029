"""Builds one scene of the growth benchmark: `python build.py FOLDER triangles|instances COUNT`.

triangles: one labelled flat mesh of about COUNT triangles that fills the picture. instances: COUNT
labelled objects that share one quad, side by side. The picture has 640 x 480 pixels.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np


def main() -> int:
    """Build and save; see the module's docstring."""
    folder, kind, count = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 12.0
    camera.location.z = 10.0
    scene.collection.objects.link(camera)
    scene.camera = camera
    if kind == "triangles":
        _link("Field", _grid(count, width=12.0, height=9.0))
    else:
        columns = math.ceil(math.sqrt(count * 4 / 3))
        cell = 12.0 / columns
        tile = _grid(2, width=cell * 0.8, height=cell * 0.8)
        for i in range(count):
            row, column = divmod(i, columns)
            _link(f"Tile.{i:05d}", tile, ((column + 0.5) * cell - 6, (row + 0.5) * cell - 4.5, 0.0))
    folder.mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), check_existing=False)
    return 0


def _link(name: str, mesh: bpy.types.Mesh, place: tuple[float, ...] = (0.0, 0.0, 0.0)) -> None:
    made = bpy.data.objects.new(name, mesh)
    made["category"] = "bed"
    made.location = place
    bpy.context.scene.collection.objects.link(made)


def _grid(triangles: int, *, width: float, height: float) -> bpy.types.Mesh:
    """A flat rectangle of rows x columns cells, two triangles each."""
    rows = max(1, round(math.sqrt(triangles / 2 * height / width)))
    columns = max(1, round(triangles / 2 / rows))
    x, y = np.meshgrid(
        np.linspace(-width / 2, width / 2, columns + 1),
        np.linspace(-height / 2, height / 2, rows + 1),
    )
    points = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    up = first + columns + 1
    corners = np.stack([first, first + 1, up + 1, first, up + 1, up], -1).ravel().astype(np.int32)
    mesh = bpy.data.meshes.new("Grid")
    mesh.vertices.add(len(points))
    mesh.attributes["position"].data.foreach_set("vector", points.ravel())
    mesh.loops.add(len(corners))
    mesh.attributes[".corner_vert"].data.foreach_set("value", corners)
    mesh.polygons.add(len(corners) // 3)
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    return mesh


if __name__ == "__main__":
    sys.exit(main())
