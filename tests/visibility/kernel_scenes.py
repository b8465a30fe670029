"""Small scenes as the kernel takes them, for its tests."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from legoworld.visibility.kernel import HOLDOUT, Cutouts, Surfaces
from legoworld.visibility.projection import Projection

Mesh = tuple[NDArray[np.float32], NDArray[np.int32]]

IDENTITY = np.eye(4)[:3]


def pixel_camera(size_wh: tuple[int, int], **changes: Any) -> Projection:
    """A perspective camera with 100 px focal length, or as changed."""
    width, height = size_wh
    values = {
        "orthographic": False,
        "fx": 100.0,
        "fy": 100.0,
        "cx": width / 2,
        "cy": height / 2,
        "z_near": 0.1,
        "z_far": 1000.0,
    }
    return Projection(**{**values, **changes})


def mesh(vertices: ArrayLike, triangles: ArrayLike) -> Mesh:
    """Arrays of the kernel's types."""
    return (
        np.asarray(vertices, np.float32).reshape(-1, 3),
        np.asarray(triangles, np.int32).reshape(-1, 3),
    )


def pixel_rectangle(
    projection: Projection, u0: float, v0: float, u1: float, v1: float, z: float = 5.0
) -> Mesh:
    """A rectangle facing the camera whose corners project to (u0, v0) and (u1, v1)."""
    depth = 1.0 if projection.orthographic else z
    x0, x1 = ((u - projection.cx) / projection.fx * depth for u in (u0, u1))
    y0, y1 = ((v - projection.cy) / projection.fy * depth for v in (v0, v1))
    corners = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
    return mesh(corners, [(0, 1, 2), (0, 2, 3)])


def place(
    meshes: Sequence[Mesh],
    placements: Sequence[tuple[int, ArrayLike, int]] | None = None,
    cutouts: Cutouts | None = None,
) -> Surfaces:
    """Meshes and (mesh, cam_from_mesh, id) placements; by default each mesh once, unmoved."""
    chosen = [(i, IDENTITY, i) for i in range(len(meshes))] if placements is None else placements
    counts = [(len(v), len(t)) for v, t in meshes]
    starts = np.concatenate([np.zeros((1, 2), np.int64), np.cumsum(counts, axis=0).reshape(-1, 2)])
    return Surfaces(
        vertices=np.concatenate([np.zeros((0, 3), np.float32), *(v for v, _ in meshes)]),
        triangles=np.concatenate([np.zeros((0, 3), np.int32), *(t for _, t in meshes)]),
        vertex_start=np.ascontiguousarray(starts[:, 0], np.int64),
        triangle_start=np.ascontiguousarray(starts[:, 1], np.int64),
        placement_mesh=np.array([m for m, _, _ in chosen], np.int32),
        cam_from_mesh=np.array([c for _, c, _ in chosen], np.float64).reshape(-1, 3, 4),
        placement_id=np.array([i for _, _, i in chosen], np.int32),
        cutouts=cutouts,
    )


def rotation(rng: np.random.Generator) -> NDArray[np.float64]:
    """A random proper rotation, (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def affine(linear: ArrayLike, offset: ArrayLike) -> NDArray[np.float64]:
    """The (3, 4) matrix of x -> linear @ x + offset."""
    return np.column_stack([np.asarray(linear, float), np.asarray(offset, float)])


def sphere(rings: int, segments: int, radius: float = 1.0) -> Mesh:
    """A closed latitude-longitude sphere around the origin, poles on the y axis."""
    theta = np.linspace(0, np.pi, rings + 1)[1:-1, None]
    phi = np.linspace(0, 2 * np.pi, segments, endpoint=False)[None, :]
    body = np.stack(
        [np.sin(theta) * np.cos(phi), np.cos(theta) + 0 * phi, np.sin(theta) * np.sin(phi)], axis=-1
    ).reshape(-1, 3)
    points = np.concatenate([[(0, 1, 0)], body, [(0, -1, 0)]]) * radius
    last = len(points) - 1
    faces = []
    for s in range(segments):
        n = (s + 1) % segments
        faces.append((0, 1 + s, 1 + n))
        for r in range(rings - 2):
            a, b = 1 + r * segments, 1 + (r + 1) * segments
            faces += [(a + s, b + s, b + n), (a + s, b + n, a + n)]
        faces.append((last, last - segments + n, last - segments + s))
    return mesh(points, faces)


def only(surfaces: Surfaces, instance_id: int) -> Surfaces:
    """The placements of one instance, under the same id; a holdout under id 0, so that it shows."""
    kept = surfaces.placement_id == instance_id
    return dataclasses.replace(
        surfaces,
        placement_mesh=surfaces.placement_mesh[kept],
        cam_from_mesh=surfaces.cam_from_mesh[kept],
        placement_id=np.maximum(surfaces.placement_id[kept], 0),
    )


def jumble(seed: int) -> tuple[Surfaces, Projection, tuple[int, int]]:
    """Loose triangles, some cut out, sheared and mirrored, some nearer than z_near.

    Ids 0 and 7 are the same triangles in the same place; a holdout has two placements.
    """
    rng = np.random.default_rng(seed)
    size_wh = (int(rng.integers(60, 150)), int(rng.integers(40, 100)))
    meshes = []
    for size in (0.05, 0.8, 5.0):
        centre = rng.normal(size=(14, 1, 3)) * 1.5 + [0, 0, 5]
        meshes.append(mesh(centre + rng.normal(size=(14, 3, 3)) * size, np.arange(42)))
    placements: list[tuple[int, ArrayLike, int]] = []
    for ident in (3, 0, 5, 5, 2, 9, HOLDOUT, HOLDOUT):
        linear = np.eye(3) + rng.normal(size=(3, 3)) * 0.3
        linear = linear @ np.diag([rng.choice([-1, 1]), 1, 1])
        placements.append((int(rng.integers(3)), affine(linear, rng.normal(size=3) * 0.5), ident))
    placements.append((placements[1][0], placements[1][1], 7))
    cutouts = Cutouts(
        triangle_cutout=rng.integers(-1, 2, 42).astype(np.int32),
        corner_uv=rng.uniform(-1, 2, size=(42, 3, 2)).astype(np.float32),
        alphas=tuple(rng.integers(0, 256, size=(3, 4), dtype=np.uint8) for _ in range(2)),
        wrap=("repeat", "mirror"),
        interpolation=("linear", "closest"),
        sides=("both", "front"),
        threshold=0.5,
    )
    camera = pixel_camera(
        size_wh,
        orthographic=seed % 3 == 0,
        fx=25.0 if seed % 3 == 0 else 60.0,
        fy=24.0 if seed % 3 == 0 else 66.0,
        z_near=float(rng.choice([0.1, 3.0])),
    )
    return place(meshes, placements, cutouts), camera, size_wh


def ball_pit(count: int) -> Surfaces:
    """Balls of 10,620 triangles, one instance for every two: more than one round of the kernel."""
    rng = np.random.default_rng(count)
    at = [
        (0, affine(rotation(rng) * 0.4, rng.uniform(-2, 2, 3) + np.array([0, 0, 6])), i // 2)
        for i in range(count)
    ]
    return place([sphere(60, 90)], at)
