"""Run with a Python that has bpy: triangle corners as read from memory against as asked for.

Prints one JSON object: what each check found.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import bpy
import numpy as np

from legoworld.scene.blender import corner_triangles
from legoworld.scene.blender.meshes import triangle_materials


def main() -> int:
    """See the module's docstring."""
    first, second = mesh("first", 5), mesh("second", 8)
    found: dict[str, Any] = {"first": agrees(first), "verdict": corner_triangles._Trust.verdict}
    asked = corner_triangles._asked_one_by_one
    corner_triangles._asked_one_by_one = refuse
    found["second_without_asking"] = agrees(second, asked)
    found["second_can_be_changed"] = corner_triangles.triangle_corners(second).flags.writeable
    corner_triangles._asked_one_by_one = asked
    found["materials"] = materials_agree(second)
    found["empty"] = list(corner_triangles.triangle_corners(bpy.data.meshes.new("none")).shape)
    corner_triangles._TRIANGLE_BYTES = 16  # as if Blender kept them otherwise
    found["laid_out_otherwise"] = agrees(second)
    corner_triangles._Trust.verdict = None
    found["laid_out_otherwise_from_the_start"] = agrees(first) and agrees(second)
    found["verdict_then"] = corner_triangles._Trust.verdict
    print("\n" + json.dumps(found))
    return 0


def mesh(name: str, sides: int) -> Any:
    """A prism: quads that are not flat, two n-gons and a triangle, two materials."""
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = [(np.cos(a), np.sin(a), 0.3 * np.sin(3 * a)) for a in turn]
    points = [*ring, *((1.5 * x, y, z + 1 + 0.2 * x) for x, y, z in ring), (0, 0, 3)]
    walls = [(i, (i + 1) % sides, (i + 1) % sides + sides, i + sides) for i in range(sides)]
    faces = [tuple(range(sides)), *walls, tuple(range(2 * sides - 1, sides - 1, -1))]
    made = bpy.data.meshes.new(name)
    made.from_pydata(points, [], [*faces, (sides, sides + 1, 2 * sides)])
    for number, polygon in enumerate(made.polygons):
        polygon.material_index = number % 2
    return made


def agrees(mesh: Any, asked: Any = None) -> bool:
    """Whether the corners are those that Blender gives when it is asked for each."""
    mesh.calc_loop_triangles()
    expected = (asked or corner_triangles._asked_one_by_one)(mesh)
    corners = corner_triangles.triangle_corners(mesh)
    return bool(len(expected) > 10 and np.array_equal(corners, expected))


def materials_agree(mesh: Any) -> bool:
    """Whether each triangle has the material of its own face."""
    expected = [t.material_index for t in mesh.loop_triangles]
    return triangle_materials(mesh).tolist() == expected and set(expected) == {0, 1}


def refuse(mesh: Any) -> Any:
    """Stands where the slow way must not be taken."""
    raise AssertionError(f"{mesh.name} was asked one by one")


if __name__ == "__main__":
    sys.exit(main())
