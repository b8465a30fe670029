"""Affine transforms written out by hand, beside NumPy's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scene.by_hand import CAMERA

from legoworld.scene.affine import (
    cam_from_mesh,
    cross,
    dot,
    inverse,
    length,
    transform_points,
    unit,
)

RANDOM = np.random.default_rng(5)
MATRIX = RANDOM.normal(size=(3, 4))
A, B = RANDOM.normal(size=(2, 4, 5, 3))


def test_an_inverse_is_the_inverse():
    rotation = MATRIX[:, :3]
    assert inverse(rotation.tolist()) == pytest.approx(np.linalg.inv(rotation), rel=1e-12)
    with pytest.raises(ZeroDivisionError):
        inverse([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.0, 0.0, 1.0]])


def test_products_of_vectors():
    assert dot(A, B) == pytest.approx(np.einsum("ijk,ijk->ij", A, B), rel=1e-12)
    assert cross(A, B) == pytest.approx(np.cross(A, B), rel=1e-12)
    assert length(A) == pytest.approx(np.linalg.norm(A, axis=-1), rel=1e-12)


def test_a_vector_of_no_length_stays_what_it_is():
    found = unit(np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]]))
    assert found.tolist() == [[0.6, 0.0, 0.8], [0.0, 0.0, 0.0]]


def test_points_are_moved_and_directions_are_not():
    turned = A @ MATRIX[:, :3].T
    assert transform_points(MATRIX, A) == pytest.approx(turned + MATRIX[:, 3], rel=1e-12)
    assert transform_points(MATRIX, A, directions=True) == pytest.approx(turned, rel=1e-12)


def test_placements_seen_from_a_camera():
    world_from_camera = RANDOM.normal(size=(3, 4))
    camera = replace(CAMERA, world_from_camera=tuple(map(tuple, world_from_camera.tolist())))
    placements = RANDOM.normal(size=(6, 3, 4))
    last = [[0.0, 0.0, 0.0, 1.0]]
    cam_from_world = np.linalg.inv(np.vstack([world_from_camera, last]))
    found = cam_from_mesh(camera, placements)
    for one, placement in zip(found, placements, strict=True):
        expected = cam_from_world @ np.vstack([placement, last])
        assert one == pytest.approx(expected[:3], rel=1e-9, abs=1e-12)
