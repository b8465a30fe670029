"""The camera's rotation from a picture's lines, against rooms whose camera is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plugin.synthetic import SIZE, camera, picture, room

from legoworld.plugin.vanishing_points import (
    UndeterminedError,
    _best_proposal,
    _segments,
    manhattan_camera,
)


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
        except UndeterminedError:
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
    with pytest.raises(UndeterminedError):
        manhattan_camera(gray, 60)


def test_a_steep_view_along_the_walls_does_not_tell_which_way_is_up():
    random = np.random.default_rng(5)
    triangles, place = room(random), np.array([0.0, -3.0, 2.6])
    for pitch_deg in (-20, -46):
        c, s = math.cos(math.radians(pitch_deg)), math.sin(math.radians(pitch_deg))
        world_from_cam = np.array([[1.0, 0, 0], [0, s, c], [0, -c, s]])
        gray = picture(triangles, world_from_cam, place, 75, random)
        if pitch_deg == -20:
            assert error_deg(manhattan_camera(gray, 75).world_from_cam, world_from_cam) <= 1.0
        else:
            with pytest.raises(UndeterminedError, match="could be up"):
                manhattan_camera(gray, 75)


@pytest.mark.parametrize(("length", "found"), [(12, 0), (40, 9)])
def test_a_line_shorter_than_a_fiftieth_of_the_diagonal_tells_nothing(length, found):
    gray = np.full((600, 800), 255, np.uint8)  # the diagonal is 1000
    for row in range(3):
        for column in range(3):
            y, x = 100 + 150 * row, 100 + 250 * column
            gray[y : y + 4, x : x + length] = 0
    segments = _segments(gray)
    lengths = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    assert (lengths >= 20).all()
    assert len(segments) >= found
    assert (len(segments) == 0) == (found == 0)
    assert list(lengths) == sorted(lengths, reverse=True)


def test_lines_that_are_one_line_cross_nowhere():
    normals = np.tile([0.0, 0.6, 0.8], (9, 1))
    with pytest.raises(UndeterminedError, match="all lines"):
        _best_proposal(normals, np.ones(9))
