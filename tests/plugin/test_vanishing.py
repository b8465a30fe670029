"""The camera's rotation from a picture's lines, against rooms whose camera is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from legoworld.plugin.vanishing import UntoldError, manhattan_camera
from legoworld.visibility.kernel import render
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import Surfaces

SIZE = (640, 480)


def box(low, high):
    """(12, 3, 3) triangles of a box, two for each of its six faces in a row."""
    low, high = np.array(low, float), np.array(high, float)
    quads = []
    for axis in range(3):
        for side in (low, high):
            corner = low.copy()
            corner[axis] = side[axis]
            u, v = np.zeros(3), np.zeros(3)
            a, b = [i for i in range(3) if i != axis]
            u[a], v[b] = high[a] - low[a], high[b] - low[b]
            quads += [[corner, corner + u, corner + u + v], [corner, corner + u + v, corner + v]]
    return np.array(quads)


def room(random):
    """A room of boxes: (T, 3, 3) triangles, each face of each box a shade of its own."""
    boxes = [box((-3, -4, 0), (3, 4, 2.8))]
    for _ in range(6):
        low = [random.uniform(-2.5, 1.5), random.uniform(-1, 3), 0]
        size = [random.uniform(0.4, 1.2), random.uniform(0.4, 1), random.uniform(0.4, 1.8)]
        boxes.append(box(low, np.add(low, size)))
    return np.concatenate(boxes)


def camera(random):
    """(3, 3) world_from_cam and a place: looking along +y, turned, tilted and rolled a little."""
    yaw, pitch, roll = np.radians(
        [random.uniform(-35, 35), random.uniform(-20, 10), random.uniform(-3, 3)]
    )
    forward = np.array(
        [math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    rolled = right * math.cos(roll) + down * math.sin(roll)
    return np.stack([rolled, np.cross(forward, rolled), forward], axis=1), np.array(
        [random.uniform(-1, 1), -3.5, random.uniform(1.2, 1.8)]
    )


def picture(triangles, world_from_cam, place, hfov_deg, random):
    """What the kernel sees, faces in random greys, with a little noise as a photo has."""
    focal = SIZE[0] / 2 / math.tan(math.radians(hfov_deg) / 2)
    in_cam = (triangles - place) @ world_from_cam
    vertices = in_cam.reshape(-1, 3).astype(np.float32)
    n_faces = len(triangles) // 2
    surfaces = Surfaces(
        vertices=vertices,
        triangles=np.tile(np.arange(6, dtype=np.int32).reshape(2, 3), (n_faces, 1)),
        vertex_start=np.arange(0, len(vertices) + 1, 6, dtype=np.int64),
        triangle_start=np.arange(0, 2 * n_faces + 1, 2, dtype=np.int64),
        placement_mesh=np.arange(n_faces, dtype=np.int32),
        cam_from_mesh=np.tile(np.eye(3, 4), (n_faces, 1, 1)),
        placement_id=np.arange(n_faces, dtype=np.int32),
        cutouts=None,
    )
    seen = render(
        surfaces,
        Projection(
            orthographic=False, fx=focal, fy=focal, cx=SIZE[0] / 2, cy=SIZE[1] / 2,
            z_near=0.01, z_far=100.0,
        ),
        SIZE,
    )  # fmt: skip
    shades = random.uniform(30, 225, n_faces + 1)
    noisy = shades[seen.instance] + random.normal(0, 2, seen.instance.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def error_deg(estimate, truth):
    """The smallest turn between two rotations, whatever horizontal axis is called x."""
    turns = []
    for quarter in range(4):
        c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter]
        named = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ estimate
        cosine = (np.trace(named @ truth.T) - 1) / 2
        turns.append(math.degrees(math.acos(min(1.0, max(-1.0, cosine)))))
    return min(turns)


def test_rooms_of_known_cameras_are_found_to_a_degree():
    errors, unknown = [], 0
    for seed in range(30):
        random = np.random.default_rng(seed)
        world_from_cam, place = camera(random)
        hfov = random.uniform(45, 85)
        gray = picture(room(random), world_from_cam, place, hfov, random)
        try:
            found = manhattan_camera(gray, hfov)
        except UntoldError:
            unknown += 1
            continue
        assert np.allclose(found.world_from_cam @ found.world_from_cam.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(found.world_from_cam) == pytest.approx(1.0)
        errors.append(error_deg(found.world_from_cam, world_from_cam))
    assert unknown <= 1
    assert np.median(errors) <= 0.3, errors
    assert np.mean(np.array(errors) <= 1.0) >= 0.95, errors


def test_the_same_picture_gives_the_same_bytes():
    random = np.random.default_rng(3)
    gray = picture(room(random), *camera(random), 60, random)
    first, second = (manhattan_camera(gray, 60).world_from_cam for _ in range(2))
    assert first.tobytes() == second.tobytes()


@pytest.mark.parametrize("name", ["flat", "noise", "circles", "one direction"])
def test_a_picture_that_does_not_tell_is_unknown(name):
    import cv2

    random = np.random.default_rng(0)
    gray = np.full(SIZE[::-1], 128, np.uint8)
    if name == "noise":
        gray = random.integers(0, 255, SIZE[::-1]).astype(np.uint8)
    if name == "circles":
        for _ in range(40):
            centre = (int(random.integers(640)), int(random.integers(480)))
            cv2.circle(gray, centre, int(random.integers(10, 60)), int(random.integers(255)), -1)
    if name == "one direction":
        for x in range(20, 640, 30):
            gray[:, x : x + 12] = 220
    with pytest.raises(UntoldError):
        manhattan_camera(gray, 60)
