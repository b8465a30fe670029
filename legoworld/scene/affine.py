"""Affine transforms in plain float64 with the same rounding on every CPU.

Products are written out: BLAS rounds differently from CPU to CPU, and the same scene must give the
same bytes on all of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.snapshot import SceneCamera

Rows = list[list[float]]


def cam_from_mesh(camera: SceneCamera, world_from_mesh: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S, 3, 4) float64 camera-from-mesh transforms of (S, 3, 4) placements."""
    rotation = [list(row[:3]) for row in camera.world_from_camera]
    origin = np.array([row[3] for row in camera.world_from_camera], np.float64)
    moved = world_from_mesh.copy()
    moved[:, :, 3] -= origin
    x, y, z = np.array(inverse(rotation)).T[:, None, :, None]
    result: NDArray[np.float64] = x * moved[:, 0:1] + y * moved[:, 1:2] + z * moved[:, 2:3]
    return result


def inverse(m: Rows) -> Rows:
    """The inverse of a matrix's left 3 x 3 by cofactors. ZeroDivisionError if singular."""
    cofactors = [
        [
            m[(r + 1) % 3][(c + 1) % 3] * m[(r + 2) % 3][(c + 2) % 3]
            - m[(r + 1) % 3][(c + 2) % 3] * m[(r + 2) % 3][(c + 1) % 3]
            for c in range(3)
        ]
        for r in range(3)
    ]
    determinant = sum(m[0][c] * cofactors[0][c] for c in range(3))
    return [[cofactors[c][r] / determinant for c in range(3)] for r in range(3)]


def transform_points(
    matrix: NDArray[np.float64], points: NDArray[np.float64], *, directions: bool = False
) -> NDArray[np.float64]:
    """(..., 3) points, or directions, after a (3, 4) transform."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    rows = [
        row[0] * x + row[1] * y + row[2] * z + (0.0 if directions else row[3])
        for row in matrix.tolist()
    ]
    return np.stack(rows, axis=-1)


def length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...) lengths of (..., 3) vectors."""
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...) products of (..., 3) vectors."""
    return np.asarray(
        a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2], np.float64
    )


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) cross products of (..., 3) vectors."""
    return np.stack(
        [
            a[..., (i + 1) % 3] * b[..., (i + 2) % 3] - a[..., (i + 2) % 3] * b[..., (i + 1) % 3]
            for i in range(3)
        ],
        axis=-1,
    )


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) vectors of length 1; a vector of length 0 stays 0."""
    size = length(vectors)[..., None]
    return np.divide(vectors, size, out=np.zeros_like(vectors), where=size > 0)
