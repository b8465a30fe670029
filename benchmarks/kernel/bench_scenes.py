"""The scenes the kernel is timed on, as it takes them; made from formulas and a fixed seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility.kernel import Surfaces
from legoworld.visibility.projection import Projection

Mesh = tuple[NDArray[np.float32], NDArray[np.int32]]


def camera(size_wh: tuple[int, int]) -> Projection:
    """50 mm on a 36 mm sensor, clip 0.1 .. 1000."""
    width, height = size_wh
    focal = 50 / 36 * width
    return Projection(
        orthographic=False,
        fx=focal,
        fy=focal,
        cx=width / 2,
        cy=height / 2,
        z_near=0.1,
        z_far=1000.0,
    )


def grid(rows: int, columns: int, close_columns: bool) -> NDArray[np.int32]:
    """Two triangles per cell of a (rows + 1) x (columns + 1) lattice; columns may wrap around."""
    width = columns if close_columns else columns + 1
    r, c = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    n = (c + 1) % width
    a, b, d, e = r * width + c, r * width + n, (r + 1) * width + c, (r + 1) * width + n
    return np.stack([a, d, e, a, e, b], axis=-1).reshape(-1, 3).astype(np.int32)


def ball(rows: int, columns: int, roughness: float = 0.0) -> Mesh:
    """A sphere of radius 1 with 2 * rows * columns triangles, optionally rippled."""
    theta = np.linspace(0, np.pi, rows + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None, :]
    radius = 1 + roughness * np.sin(40 * theta) * np.sin(60 * phi)
    points = np.stack(
        [
            radius * np.sin(theta) * np.cos(phi),
            radius * np.cos(theta) + 0 * phi,
            radius * np.sin(theta) * np.sin(phi),
        ],
        axis=-1,
    )
    return points.reshape(-1, 3).astype(np.float32), grid(rows, columns, close_columns=True)


def box() -> Mesh:
    """A cube of side 2."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return corners, np.array(faces, np.int32)


def floor(half: float, y: float) -> Mesh:
    """A horizontal square below the camera (y points down), reaching behind it."""
    corners = [(-half, y, -half), (half, y, -half), (half, y, half), (-half, y, half)]
    return np.array(corners, np.float32), np.array([(0, 1, 2), (0, 2, 3)], np.int32)


def placed(meshes: list[Mesh], chosen: list[int], cam_from_mesh: NDArray[np.float64]) -> Surfaces:
    """Meshes with one placement per entry of `chosen`, ids in order."""
    vertex_start = np.concatenate([[0], np.cumsum([len(v) for v, _ in meshes])]).astype(np.int64)
    triangle_start = np.concatenate([[0], np.cumsum([len(t) for _, t in meshes])]).astype(np.int64)
    return Surfaces(
        vertices=np.ascontiguousarray(np.concatenate([v for v, _ in meshes])),
        triangles=np.ascontiguousarray(np.concatenate([t for _, t in meshes])),
        vertex_start=vertex_start,
        triangle_start=triangle_start,
        placement_mesh=np.array(chosen, np.int32),
        cam_from_mesh=np.ascontiguousarray(cam_from_mesh, np.float64),
        placement_id=np.arange(len(chosen), dtype=np.int32),
        cutouts=None,
    )


def scatter(
    rng: np.random.Generator, count: int, half: tuple[float, float, float], z: float, size: float
) -> NDArray[np.float64]:
    """(count, 3, 4) random rotations, sizes around `size`, centres in a box `z` in front."""
    q, _ = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    scale = size * rng.uniform(0.6, 1.4, size=(count, 1, 1))
    centre = rng.uniform(-1, 1, size=(count, 3)) * np.array(half) + [0, 0, z]
    return np.concatenate([q * scale, centre[:, :, None]], axis=2)


def primitives() -> Surfaces:
    """30 primitives of a scene program and a floor, 5.7k triangles."""
    rng = np.random.default_rng(0)
    meshes = [box(), ball(12, 24), floor(40, 2.5)]
    chosen = [i % 5 == 0 for i in range(30)]
    matrices = scatter(rng, 30, (3.5, 2.2, 3.0), 11.0, 0.8)
    identity = np.eye(4)[None, :3]
    return placed(
        meshes, [0 if c else 1 for c in chosen] + [2], np.concatenate([matrices, identity])
    )


def spheres() -> Surfaces:
    """100 distinct rippled spheres, 512k triangles."""
    rng = np.random.default_rng(1)
    meshes = [ball(40, 64, 0.01 * i / 100) for i in range(100)]
    return placed(meshes, list(range(100)), scatter(rng, 100, (4.5, 3.2, 4.0), 14.0, 0.7))


def objects() -> Surfaces:
    """2,000 distinct objects, 1M triangles."""
    rng = np.random.default_rng(2)
    meshes = [ball(10, 25, 0.05 * i / 2000) for i in range(2000)]
    return placed(meshes, list(range(2000)), scatter(rng, 2000, (8.0, 6.0, 8.0), 24.0, 0.4))


def one_mesh() -> Surfaces:
    """One rippled mesh of 5M triangles."""
    matrix = np.array([[[1.6, 0, 0, 0], [0, 1.6, 0, 0], [0, 0, 1.6, 6.0]]])
    return placed([ball(1581, 1581, 0.02)], [0], matrix)


def sliver_room() -> Surfaces:
    """A room whose walls are n-gons cut as fans from a corner behind the camera, 5,600 slivers."""
    rim, half, length = 1402, 2.0, 20.0
    turn = np.linspace(0, 4, rim, endpoint=False)
    side, along = turn.astype(int), turn % 1
    u = np.choose(side, [along, np.ones(rim), 1 - along, np.zeros(rim)])
    w = np.choose(side, [np.zeros(rim), along, np.ones(rim), 1 - along])
    fan = np.stack([np.zeros(rim - 2), np.arange(1, rim - 1), np.arange(2, rim)], axis=1)
    walls: list[Mesh] = []
    for axis, sign in ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)):
        points = np.zeros((rim, 3))
        points[:, axis] = sign * half
        points[:, 1 - axis] = (2 * u - 1) * half
        points[:, 2] = -length / 4 + w * 1.25 * length
        walls.append((points.astype(np.float32), fan.astype(np.int32)))
    return placed(walls, [0, 1, 2, 3], np.repeat(np.eye(4)[None, :3], 4, axis=0))


def instances() -> Surfaces:
    """10,000 placements of one mesh, 12.8M virtual triangles."""
    rng = np.random.default_rng(3)
    return placed([ball(20, 32, 0.05)], [0] * 10_000, scatter(rng, 10_000, (12, 9, 12), 36.0, 0.25))


def layer() -> Surfaces:
    """10,000 placements side by side, none behind another, 12.8M virtual triangles."""
    x, y = np.meshgrid(np.arange(100) - 49.5, np.arange(100) - 49.5)
    centre = np.stack([0.24 * x.ravel(), 0.18 * y.ravel(), np.full(10_000, 36.0)], axis=-1)
    turns = np.tile(0.08 * np.eye(3), (10_000, 1, 1))
    matrices = np.concatenate([turns, centre[:, :, None]], axis=2)
    return placed([ball(20, 32, 0.05)], [0] * 10_000, matrices)


SCENES: dict[str, Callable[[], Surfaces]] = {
    "primitives": primitives,
    "spheres": spheres,
    "objects": objects,
    "one_mesh": one_mesh,
    "sliver_room": sliver_room,
    "instances": instances,
    "layer": layer,
}

SIZES: dict[int, tuple[int, int]] = {640: (640, 480), 1920: (1920, 1080), 6048: (6048, 4032)}
