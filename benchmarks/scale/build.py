"""Builds one scene of the scale benchmark: `python build.py NAME SCENE_FOLDER`, in its own process.

Every scene is made so that its right answer is known without a renderer; `answers.py` holds it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np

GRID_WH = (280, 250)  # 70,000 cells of 4 x 4 pixels: a picture of 1120 x 1000
PLACED_WH = (100, 100)
ROOM_HALF = (2.0, 1.5)
ROOM_FAR = 6.0


def main() -> int:
    """Build and save; see the module's docstring."""
    name, folder = sys.argv[1], Path(sys.argv[2])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    SCENES[name](bpy.context.scene)
    folder.mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), check_existing=False)
    return 0


def objects_70k(scene: Any) -> None:
    """70,000 labelled objects that share one quad, each on the middle 2 x 2 of its 4 x 4 pixels."""
    columns, rows = GRID_WH
    _size(scene, 4 * columns, 4 * rows)
    _camera(scene, z=10.0, ortho_scale=4.0 * columns)
    tile = _quad("Tile", half=1.0)
    for i in range(columns * rows):
        made = bpy.data.objects.new(f"Tile.{i:05d}", tile)
        row, column = divmod(i, columns)
        made.location = _cell_centre(column, row, GRID_WH, 4.0)
        made["category"] = "dog"
        scene.collection.objects.link(made)


def placements_10k(scene: Any) -> None:
    """One labelled ball of 1,280 triangles, placed 10,000 times by geometry nodes."""
    columns, rows = PLACED_WH
    _size(scene, 8 * columns, 8 * rows)
    _camera(scene, z=10.0, ortho_scale=8.0 * columns)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4, radius=3.0)
    ball = bpy.context.object
    ball.name = "Ball"
    ball["category"] = "sports ball"
    ball.hide_render = True  # the prototype itself: only its placements are seen
    points = bpy.data.meshes.new("Points")
    cells = [_cell_centre(c, r, PLACED_WH, 8.0) for r in range(rows) for c in range(columns)]
    points.from_pydata(cells, [], [])
    holder = bpy.data.objects.new("Placer", points)
    scene.collection.objects.link(holder)
    holder.modifiers.new("Place", "NODES").node_group = _placing_nodes(ball)


def mesh_5m(scene: Any) -> None:
    """One flat mesh of 5,000,000 triangles that fills the picture, 5 m before the camera."""
    _size(scene, 640, 480)
    _camera(scene, z=5.0)
    columns, rows = 2500, 1000
    x, y = np.meshgrid(np.linspace(-6, 6, columns + 1), np.linspace(-5, 5, rows + 1))
    flat = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    right, up = first + 1, first + columns + 1
    corners = np.stack([first, right, up + 1, first, up + 1, up], -1).ravel().astype(np.int32)
    mesh = bpy.data.meshes.new("Field")
    mesh.vertices.add(len(flat))
    mesh.attributes["position"].data.foreach_set("vector", flat.ravel())
    mesh.loops.add(len(corners))
    mesh.attributes[".corner_vert"].data.foreach_set("value", corners)
    mesh.polygons.add(len(corners) // 3)
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    field = bpy.data.objects.new("Field", mesh)
    field["category"] = "bed"
    scene.collection.objects.link(field)


def near_plane_room(scene: Any) -> None:
    """A corridor of slivers that runs from far behind the camera to a wall before it."""
    _size(scene, 640, 480)
    _camera(scene, z=0.0, clip_start=0.1)
    half_x, half_y = ROOM_HALF
    slats = 2000
    for name, axis, side in (("Left", 0, -1), ("Right", 0, 1), ("Floor", 1, -1), ("Roof", 1, 1)):
        along = (half_y, half_x)[axis]
        cuts = np.linspace(-along, along, slats + 1)
        at = side * (half_x, half_y)[axis]
        ends = [(at, c, z) if axis == 0 else (c, at, z) for c in cuts for z in (50.0, -ROOM_FAR)]
        faces = [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(slats)]
        _object(scene, name, ends, faces, category="bed")
    back = [(x, y, -ROOM_FAR) for x, y in ((-2, -1.5), (2, -1.5), (2, 1.5), (-2, 1.5))]
    _object(scene, "Back", back, [(0, 1, 2, 3)], category="tv")


def millimetres(scene: Any) -> None:
    """5 m away in a scene whose unit is a millimetre."""
    _unit_scene(scene, 0.001)


def kilometres(scene: Any) -> None:
    """5 km away in a scene whose unit is a kilometre."""
    _unit_scene(scene, 1000.0)


def far_from_origin(scene: Any) -> None:
    """Camera and plane 1,000 km from the origin, 5 m apart: float32 steps there are 0.0625 m."""
    _size(scene, 640, 480)
    _camera(scene, z=5.0).location.x = 1e6
    _object(scene, "Plane", _quad_corners(20.0), [(0, 1, 2, 3)], category="bed").location.x = 1e6


def _unit_scene(scene: Any, metres_per_unit: float) -> None:
    five = {0.001: 5000.0, 1000.0: 5.0}[metres_per_unit]
    scene.unit_settings.system = "METRIC"
    scene.unit_settings.scale_length = metres_per_unit
    _size(scene, 640, 480)
    _camera(scene, z=five, clip_start=five / 1000, clip_end=five * 10)
    _object(scene, "Plane", _quad_corners(five / 2), [(0, 1, 2, 3)], category="bed")


def _size(scene: Any, width: int, height: int) -> None:
    scene.render.resolution_x, scene.render.resolution_y = width, height


def _camera(scene: Any, *, z: float, ortho_scale: float | None = None, **settings: float) -> Any:
    data = bpy.data.cameras.new("Camera")
    data.lens = data.sensor_width = 36.0
    data.clip_end = 1000.0
    if ortho_scale is not None:
        data.type, data.ortho_scale = "ORTHO", ortho_scale
    for key, value in settings.items():
        setattr(data, key, value)
    made = bpy.data.objects.new("Camera", data)
    made.location.z = z
    scene.collection.objects.link(made)
    scene.camera = made
    return made


def _object(scene: Any, name: str, vertices: Any, faces: Any, *, category: str) -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    made = bpy.data.objects.new(name, mesh)
    made["category"] = category
    scene.collection.objects.link(made)
    return made


def _quad(name: str, half: float) -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(_quad_corners(half), [], [(0, 1, 2, 3)])
    return mesh


def _quad_corners(half: float) -> list[tuple[float, float, float]]:
    return [(x * half, y * half, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def _cell_centre(
    column: int, row: int, grid_wh: tuple[int, int], cell: float
) -> tuple[float, float, float]:
    """The middle of a cell; row 0 is the top of the picture."""
    return ((column - grid_wh[0] / 2 + 0.5) * cell, (grid_wh[1] / 2 - row - 0.5) * cell, 0.0)


def _placing_nodes(prototype: Any) -> Any:
    tree = bpy.data.node_groups.new("Place", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    enter, leave = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    info = tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = prototype
    info.inputs["As Instance"].default_value = True
    place = tree.nodes.new("GeometryNodeInstanceOnPoints")
    tree.links.new(enter.outputs[0], place.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], place.inputs["Instance"])
    tree.links.new(place.outputs[0], leave.inputs[0])
    return tree


SCENES: dict[str, Callable[[Any], None]] = {
    scene.__name__: scene
    for scene in (
        objects_70k,
        placements_10k,
        mesh_5m,
        near_plane_room,
        millimetres,
        kilometres,
        far_from_origin,
    )
}

if __name__ == "__main__":
    assert math.prod(GRID_WH) == 70_000
    sys.exit(main())
