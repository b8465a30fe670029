"""The triangles of the shipped .glb files as trimesh reads them, which shares no code with ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scene.gltf.documents import read

EXAMPLES = Path(__file__).parents[3] / "examples"
#: glTF is y-up, a snapshot z-up: (x, y, z) becomes (x, -z, y).
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def place_vertices(vertices: np.ndarray, world: np.ndarray) -> np.ndarray:
    return np.asarray(vertices, np.float64) @ world[:3, :3].T + world[:3, 3]


@pytest.mark.parametrize("name", ["astronaut", "chelsea", "coffee", "motorcycle"])
def test_the_same_triangles_in_the_same_places(name):
    path = EXAMPLES / name / "scene.glb"
    snapshot = read(path.read_bytes(), path.parent)
    ours = []
    for mesh, world in zip(snapshot.surface_mesh, snapshot.world_from_mesh, strict=True):
        vertices = slice(snapshot.vertex_start[mesh], snapshot.vertex_start[mesh + 1])
        triangles = slice(snapshot.triangle_start[mesh], snapshot.triangle_start[mesh + 1])
        ours.append(
            place_vertices(snapshot.vertices[vertices], world)[snapshot.triangles[triangles]]
        )
    scene = trimesh.load_scene(path, process=False)
    theirs = []
    for node in scene.graph.nodes_geometry:
        world, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        theirs.append((place_vertices(mesh.vertices, world) @ Z_UP.T)[mesh.faces])
    # The readers order meshes and triangles differently, so sorted quantities are compared.
    a, b = np.concatenate(ours), np.concatenate(theirs)
    assert len(a) == len(b) > 10_000
    for quantity in (corners, centres, areas):
        np.testing.assert_allclose(quantity(a), quantity(b), rtol=1e-4, atol=1e-5)


def corners(triangles: np.ndarray) -> np.ndarray:
    return np.sort(triangles.reshape(-1, 3), axis=0)


def centres(triangles: np.ndarray) -> np.ndarray:
    return np.sort(triangles.mean(axis=1), axis=0)


def areas(triangles: np.ndarray) -> np.ndarray:
    sides = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.sort(np.linalg.norm(np.cross(*sides), axis=1)) / 2
