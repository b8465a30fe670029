"""Boxes in space around instances: known sizes and places, whatever is done to the objects."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from readouts.level_view import CUBE, LEVEL, about_z, look

from legoworld.cards import load_card
from legoworld.readouts.boxes3d import KINDS, box3d_exports, box_extent_px, fit_boxes
from legoworld.readouts.detection import READOUT
from legoworld.readouts.family import AnsweredImage
from legoworld.records.base import as_json
from legoworld.scene.instances import Instance
from legoworld.tracks.vocabulary import Category
from legoworld.visibility.planar_hull import convex_hull, smallest_rectangle


def one_box(linear, place=(0, 5, 0), kind="gravity", **more):
    return fit_boxes(look((linear, place), **more), [0], kind)[0]


def close(values, expected):
    return np.asarray(values) == pytest.approx(np.asarray(expected), abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_cuboid_that_is_not_turned(kind):
    box = one_box(np.diag([1.0, 0.5, 2.0]), (0.3, 5, -0.2), kind)
    assert close(box.center_m, [0.3, 0.2, 5])
    assert close(box.size_m, [1, 2, 0.5])  # length, height, width
    assert close(box.axes, np.eye(3))
    assert close(box.corners_m[0], [-0.2, -0.8, 4.75])
    assert close(box.corners_m[6], [0.8, 1.2, 5.25])


@pytest.mark.parametrize("degrees", [-80, -30, 10, 45, 75, 170])
def test_a_turned_cuboid_keeps_its_size_and_its_length_points_right(degrees):
    linear = about_z(degrees) @ np.diag([1.0, 0.4, 2.0])
    for kind in ("gravity", "object"):
        box = one_box(linear, kind=kind)
        assert close(box.size_m, [1, 2, 0.4])
        a = np.radians(degrees)
        length = np.array([np.cos(a), 0, np.sin(a)])
        assert close(box.axes[:, 0], length if length[0] > 0 else -length)
        assert np.linalg.det(box.axes) == pytest.approx(1)
    a = np.radians(degrees)
    sides = sorted([abs(np.cos(a)) + 0.4 * abs(np.sin(a)), abs(np.sin(a)) + 0.4 * abs(np.cos(a))])
    assert close(one_box(linear, kind="world").size_m, [sides[1], 2, sides[0]])


def test_a_tilted_object_is_upright_by_gravity_and_tilted_by_its_own_axes():
    a = np.radians(20)
    tilt = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    linear = tilt @ np.diag([1.0, 0.4, 0.2])
    upright, own = one_box(linear), one_box(linear, kind="object")
    assert close(upright.axes[:, 1], [0, 1, 0])
    assert close(own.size_m, [1, 0.2, 0.4])
    assert np.degrees(np.arccos(own.axes[1, 1])) == pytest.approx(20)
    assert np.prod(own.size_m) < np.prod(upright.size_m)


@pytest.mark.parametrize("kind", KINDS)
def test_mirrored_and_sheared_placements_have_right_handed_boxes_that_hold_them(kind):
    for linear in (np.diag([-1.0, 0.5, 2.0]), [[1, 0.6, 0.2], [0, 0.5, 0], [0, 0.3, 1]]):
        made = look((np.asarray(linear, float), (0, 5, 0)))
        box = fit_boxes(made, [0], kind)[0]
        assert np.linalg.det(box.axes) == pytest.approx(1)
        points = CUBE @ np.asarray(linear, float).T + [0, 5, 0]
        inside = (points[:, [0, 2, 1]] * [1, -1, 1] - box.center_m) @ box.axes
        assert (np.abs(inside) <= box.size_m / 2 + 1e-6).all()


def test_flat_and_collapsed_objects_have_flat_boxes():
    assert close(one_box(np.diag([1.0, 0, 0.5])).size_m, [1, 0.5, 0])
    assert close(one_box(np.diag([0.0, 0, 2])).size_m, [0, 2, 0])
    for kind in KINDS:
        assert close(one_box(np.zeros((3, 3)), kind=kind).size_m, [0, 0, 0])


def test_of_footprints_that_are_equally_small_the_one_turned_least_is_taken():
    angles = np.radians(np.arange(0, 360, 15))
    round_ = np.array([[np.cos(a) / 2, np.sin(a) / 2, z] for z in (-0.5, 0.5) for a in angles])
    fan = np.array([[0, k, k + 1] for k in range(1, len(round_) - 1)], np.int32)
    one = one_box(np.eye(3), vertices=round_, triangles=fan)
    for degrees in (15, 30, 90):
        other = one_box(about_z(degrees), vertices=round_, triangles=fan)
        assert close(other.axes, one.axes)
        assert close(other.size_m, one.size_m)


def test_units_are_metres_and_a_loose_vertex_is_no_part():
    vertices = np.vstack([CUBE, [[50, 50, 50]]])
    box = one_box(np.eye(3), (0, 500, 0), unit_scale=0.01, vertices=vertices,
                  camera=replace(LEVEL, clip_end=1e4))  # fmt: skip
    assert close(box.size_m, [0.01] * 3)
    assert close(box.center_m, [0, 0, 5])


def test_the_whole_object_counts_whatever_the_picture_shows():
    """One half outside of the picture, one hidden, one through the near plane."""
    made = look(
        (np.diag([2.0, 1, 1]), (2.25, 5, 0)),
        (np.eye(3), (0, 8, 0)),
        (np.diag([3.0, 0.1, 3.0]), (0, 6, 0)),
        (np.eye(3), (0, 0.2, 0)),
    )
    cut, hidden, wall, near = fit_boxes(made, [0, 1, 2, 3])
    assert close(cut.size_m, [2, 1, 1])
    assert 0.3 < cut.truncation < 0.9
    assert close(hidden.size_m, [1, 1, 1])
    assert hidden.visibility == 0
    assert wall.truncation == pytest.approx(0, abs=0.2)
    assert near.truncation is None
    assert close(near.center_m, [0, 0, 0.2])


def test_exports_are_in_canonical_order_and_say_the_same_for_any_threads():
    made = look((np.eye(3), (1, 5, 0)), (np.eye(3), (-1, 5, 0)), (np.eye(3), (0, 30, 0)))
    instances = [
        Instance(id=i, name=str(i), objects=(str(i),), label_text=None,
                 category=Category(id=c, name=str(c)))
        for i, c in enumerate((2, 2, 1))
    ]  # fmt: skip
    exports = box3d_exports(7, instances, made)
    assert [i.id for _, i in exports] == [2, 1, 0]
    assert exports == box3d_exports(7, instances[::-1], made, threads=1)
    near = exports[1][0]
    assert near.depth == 5
    assert near.dimensions == (1, 1, 1)
    assert (near.truncation, near.visibility) == (0, 1)
    x, y, w, h = near.bbox
    box = fit_boxes(made, [1])[0]
    assert (x, y, w, h) == pytest.approx(box_extent_px(box, made), abs=1e-3)


def test_an_orthographic_camera_sees_a_box_at_its_place():
    made = look((np.eye(3), (1, 50, 0)), camera=replace(LEVEL, type="ORTHO", ortho_scale=4.0))
    box = fit_boxes(made, [0])[0]
    assert close(box.center_m, [1, 0, 50])
    assert close(box_extent_px(box, made), [62.5, 37.5, 25, 25])


def test_hulls_of_points_on_lines_and_in_one_place():
    assert len(convex_hull(np.zeros((5, 2)))) == 1
    line = np.column_stack([np.arange(40.0), np.arange(40.0)])
    assert convex_hull(line).tolist() == [[0, 0], [39, 39]]
    assert smallest_rectangle(line) == pytest.approx((2**-0.5, 2**-0.5))
    random = np.random.default_rng(1)
    points = random.normal(size=(3000, 2))
    from scipy.spatial import ConvexHull

    expected = points[ConvexHull(points).vertices]
    assert {*map(tuple, convex_hull(points))} == {*map(tuple, expected)}


def test_exports_are_what_the_card_says():
    card = load_card("boxes3d")
    made = look((np.eye(3), (0, 5, 0)))
    instance = Instance(id=0, name="0", objects=("0",), label_text=None,
                        category=Category(id=1, name="1"))  # fmt: skip
    (prediction, _), *_ = READOUT.exports(
        card.reads,
        AnsweredImage(image_id=1, name="a", run=Path(), instances=[instance], view=made),
    )
    assert sorted(as_json(prediction)) == sorted(card.value("export.fields"))
