"""KITTI's 15 columns, read by another parser, and what they cannot hold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from exports.made_views import made_view
from readouts.level_view import CUBE, FACES, LEVEL, about_z

from legoworld.exports.kitti import write_views

BOX = (CUBE * [4, 1.5, 1], FACES)  # length, width, height


def parse_labels(folder, name="000000.txt"):
    """Objects as dicts, and the camera matrix, by the columns of KITTI's readme."""
    objects = []
    for line in (folder / "label_2" / name).read_text().splitlines():
        kind, *numbers = line.split()
        assert len(numbers) == 14
        cut, occluded, alpha, *rest = map(float, numbers)
        objects.append({
            "type": kind, "truncated": cut, "occluded": occluded, "alpha": alpha,
            "bbox": rest[:4], "hwl": rest[4:7], "location": rest[7:10], "ry": rest[10],
        })  # fmt: skip
    lines = dict(row.split(": ") for row in (folder / "calib" / name).read_text().splitlines())
    return objects, np.array(lines["P2"].split(), float).reshape(3, 4)


def corners(one):
    """The eight corners as KITTI's development kit places them."""
    height, width, length = one["hwl"]
    c, s = math.cos(one["ry"]), math.sin(one["ry"])
    turned = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    x = np.array([1, 1, -1, -1, 1, 1, -1, -1]) * length / 2
    y = np.array([0, 0, 0, 0, -1, -1, -1, -1]) * height
    z = np.array([1, -1, -1, 1, 1, -1, -1, 1]) * width / 2
    return (turned @ np.array([x, y, z])).T + one["location"]


@pytest.mark.parametrize("degrees", [0, 30, 90, 140])
def test_the_corners_of_the_columns_are_those_of_the_object(tmp_path, degrees):
    place = (1.0, 12.0, -0.5)
    view = made_view(("car", "sports car", about_z(degrees), place), shape=BOX)
    made = write_views([view], tmp_path)
    (one,), p2 = parse_labels(tmp_path)
    assert one["type"] == "sports_car"
    assert "spaces in category names became _: sports car" in made.losses
    assert one["hwl"] == pytest.approx([1, 1.5, 4], abs=1e-5)
    assert one["alpha"] == pytest.approx(
        math.remainder(one["ry"] - math.atan2(*np.array(one["location"])[[0, 2]]), math.tau),
        abs=1e-5,
    )
    world = BOX[0] @ about_z(degrees).T + place
    truth = world @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]).T  # x right, y down, z forward
    apart = np.linalg.norm(corners(one)[:, None] - truth, axis=2).min(axis=0)
    assert apart.max() < 1e-5
    shown = np.column_stack([truth, np.ones(8)]) @ p2.T
    uv = shown[:, :2] / shown[:, 2:]
    assert one["bbox"] == pytest.approx([*uv.min(axis=0), *uv.max(axis=0)], abs=1e-3)


def test_truncation_occlusion_and_tilt(tmp_path):
    tilt = np.eye(4)
    tilt[1:3, 1:3] = [[0.96, -0.28], [0.28, 0.96]]
    pose = np.array(LEVEL.world_from_camera) @ tilt
    tilted = replace(LEVEL, world_from_camera=tuple(map(tuple, pose)))
    cube = (CUBE, FACES)
    view = made_view(
        ("cut", "a", 1, (-1.5, 3.5, 0)), ("seen", "b", 1, (0, 4, 0)), ("half", "c", 1, (0.5, 6, 0)),
        shape=cube,
    )  # fmt: skip
    write_views([view], tmp_path / "level")
    objects, _ = parse_labels(tmp_path / "level")
    by = {one["type"]: one for one in objects}
    assert (by["b"]["truncated"], by["b"]["occluded"]) == (0, 0)
    assert 0 < by["a"]["truncated"] < 1
    assert by["c"]["occluded"] in (1, 2)
    view = made_view(("a", "a", 1, (0, 4, 0)), camera=tilted, shape=cube)
    made = write_views([view], tmp_path / "tilted")
    assert "up to 16.3 degrees of tilt are lost" in made.losses[0]
