"""The view of a snapshot: camera, cut-outs, hold-outs, units, and what is counted of it."""

from __future__ import annotations

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from scene.by_hand import CAMERA, RENDER, HandScene
from strategies import id_pictures

from legoworld.errors import ShapeError
from legoworld.scene.instances import group
from legoworld.scene.labels import Labels
from legoworld.scene.snapshot import Cutout
from legoworld.visibility.camera import projection
from legoworld.visibility.runs import instance_extents
from legoworld.visibility.view import unseen_reasons, view

SIZE = (64, 48)
NO_LABELS = Labels(objects={}, collections={}, warnings=())


def project_point(camera, x, y, z):
    depth = 1.0 if camera.orthographic else z
    return camera.cx + camera.fx * x / depth, camera.cy + camera.fy * y / depth


def cards(**columns):
    """A snapshot of squares that face the camera: name=(x, y, half side, distance)."""
    hand = HandScene()
    for name in columns:
        hand.object(name)
        hand.occurs(name)
    snapshot = hand.snapshot()
    eye = np.array(CAMERA.world_from_camera)
    matrices = np.zeros((len(columns), 3, 4))
    for row, name in enumerate(
        snapshot.objects[i].name for i in snapshot.occurrence_object[snapshot.surface_occurrence]
    ):
        x, y, half, distance = columns[name]
        local = np.array([[half, 0, 0, x], [0, half, 0, y], [0, 0, 1, distance], [0, 0, 0, 1.0]])
        matrices[row] = eye @ local
    return replace(
        snapshot,
        vertices=np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32),
        triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        vertex_start=np.array([0, 4], np.int64),
        triangle_start=np.array([0, 2], np.int64),
        world_from_mesh=matrices,
    )


def view_snapshot(snapshot, size_wh=SIZE):
    grouping = group(snapshot, NO_LABELS)
    result = view(snapshot, grouping, size_wh)
    ids = {instance.name: instance.id for instance in grouping.instances}
    return grouping, result, ids


@given(
    kind=st.sampled_from(["PERSP", "ORTHO"]),
    fit=st.sampled_from(["AUTO", "HORIZONTAL", "VERTICAL"]),
    aspect=st.tuples(st.floats(0.5, 3), st.floats(0.5, 3)) | st.just((1.0, 1.0)),
    size_wh=st.tuples(st.integers(1, 8192), st.integers(1, 8192)) | st.just((50, 50)),
    lens_mm=st.floats(10, 300),
    ortho_scale=st.floats(0.01, 1000),
)
def test_the_sensor_spans_the_side_it_is_fitted_to(
    kind, fit, aspect, size_wh, lens_mm, ortho_scale
):
    camera = replace(
        CAMERA, type=kind, sensor_fit=fit, lens_mm=lens_mm, ortho_scale=ortho_scale,
        clip_start=0.3, clip_end=70.0,
    )  # fmt: skip
    render = replace(RENDER, pixel_aspect_x=aspect[0], pixel_aspect_y=aspect[1])
    made = projection(camera, render, size_wh)
    (width, height), (wide, high) = size_wh, aspect
    horizontal = fit == "HORIZONTAL" or (fit == "AUTO" and width * wide >= height * high)
    sensor = 24.0 if fit == "VERTICAL" else 36.0
    distance = 3.0
    half = ortho_scale / 2 if kind == "ORTHO" else distance * sensor / 2 / lens_mm
    if horizontal:
        assert project_point(made, half, 0, distance) == pytest.approx((width, height / 2))
        assert project_point(made, -half, 0, distance) == pytest.approx((0, height / 2))
    else:
        assert project_point(made, 0, half, distance) == pytest.approx((width / 2, height))
        assert project_point(made, 0, -half, distance) == pytest.approx((width / 2, 0))
    # A square in the scene covers wide / high times as many pixels downwards as across.
    assert made.fy / made.fx == pytest.approx(wide / high)
    assert (made.orthographic, made.z_near, made.z_far) == (kind == "ORTHO", 0.3, 70.0)
    shifted = projection(replace(camera, shift_x=0.25, shift_y=-0.5), render, size_wh)
    x, y = (0.25 * 2 * half, 0.5 * 2 * half)  # a shift of 1 is the whole fitted side
    assert project_point(shifted, x, y, distance) == pytest.approx((width / 2, height / 2))


@given(id_pictures())
def test_area_and_extent_are_those_of_the_pixels(ids):
    n = int(ids.max()) + 3
    area, extents = instance_extents(ids, n)
    for number in range(n):
        rows, columns = np.nonzero(ids == number)
        assert area[number] == len(rows)
        box = [0, 0, 0, 0]
        if len(rows):
            box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert extents[number].tolist() == box


def test_an_id_beyond_the_instances_is_refused():
    with pytest.raises(ShapeError, match="not among"):
        instance_extents(np.array([[-1, 0], [1, 2]], np.int32), 2)


def test_depth_is_in_metres_and_areas_are_of_the_picture():
    snapshot = cards(Near=(-1, 0, 1, 4), Far=(0, 0, 50, 8))
    snapshot = replace(snapshot, render=replace(RENDER, unit_scale=0.25))
    _, result, ids = view_snapshot(snapshot)
    instance = result.buffers.instance
    assert result.size_wh == SIZE
    # x of -2 .. 0 at a distance of 4 is the left half of the picture's middle 32 rows.
    assert tuple(result.bbox_xyxy_px[ids["Near"]]) == (0, 8, 32, 40)
    assert result.area_px.tolist() == [int((instance == i).sum()) for i in range(2)]
    assert result.area_px[ids["Near"]] == 32 * 32
    assert set(result.buffers.depth_z_m[instance == ids["Near"]].tolist()) == {1.0}
    assert set(result.buffers.depth_z_m[instance == ids["Far"]].tolist()) == {2.0}


def cut(snapshot, texels, uv, **changes):
    """Every triangle has the one picture; uv: (2, 3, 2) of the card's two triangles."""
    settings = {"wrap": "repeat", "interpolation": "closest", **changes}
    return replace(
        snapshot,
        cutouts=(Cutout(name="Picture", **settings),),
        cutout_alphas=(np.array(texels, np.uint8),),
        triangle_cutout=np.zeros(2, np.int32),
        corner_uv=np.array(uv, np.float32),
    )


#: u runs from 0 to 1 with x, v upwards: the card's corners run with y downwards.
UV = [[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]]


def first_mask(snapshot):
    return view_snapshot(snapshot)[1].buffers.instance == 0


def test_a_picture_s_alpha_cuts_a_card():
    card = cards(Card=(0, 0, 1, 4))
    expected = np.zeros((48, 64), bool)
    expected[8:40, 16:48] = True
    np.testing.assert_array_equal(first_mask(card), expected)
    expected[:, 32:] = False
    np.testing.assert_array_equal(first_mask(cut(card, [[255, 0]], UV)), expected)


@pytest.mark.parametrize(
    ("wrap", "columns"),
    [
        ("repeat", [*range(16, 24), *range(32, 40)]),
        ("mirror", [*range(16, 24), *range(40, 48)]),
        ("extend", range(16, 24)),
        ("clip", range(16, 24)),
    ],
)
def test_what_lies_beside_the_picture_is_by_its_wrap(wrap, columns):
    twice = np.array(UV) * [2, 1]  # u runs from 0 to 2, and the picture's first half is there
    card = cut(cards(Card=(0, 0, 1, 4)), [[255, 0]], twice, wrap=wrap)
    assert np.flatnonzero(first_mask(card).any(axis=0)).tolist() == [*columns]


def test_the_border_goes_on_under_extend_and_ends_under_clip():
    twice = np.array(UV) * [2, 1]
    card = cut(cards(Card=(0, 0, 1, 4)), [[255]], twice, wrap="extend")
    assert first_mask(card).sum() == 32 * 32
    assert first_mask(cut(card, [[255]], twice, wrap="clip")).sum() == 16 * 32


def test_alpha_runs_from_texel_centre_to_texel_centre_where_it_is_linear():
    card = cut(cards(Card=(0, 0, 1.5, 4)), [[255, 255, 255, 90]], UV, wrap="extend")
    assert first_mask(card).sum() == 36 * 48
    # Texel centres at u = 0.625 and 0.875: alpha falls to a half at u = 0.818, 39.3 pixels of 48.
    linear = cut(card, [[255, 255, 255, 90]], UV, wrap="extend", interpolation="linear")
    assert first_mask(linear).sum() == 39 * 48


@pytest.mark.parametrize(("sides", "there"), [("both", True), ("front", False), ("back", True)])
def test_a_side_that_is_not_there(sides, there):
    # The corners run clockwise as the camera sees them: it looks at the back.
    card = cut(cards(Card=(0, 0, 1, 4)), [[255]], UV, sides=sides)
    assert first_mask(card).any() == there


def test_alpha_of_corners_is_multiplied():
    card = cut(cards(Card=(0, 0, 1, 4)), [[255]], UV)
    # 1 on the left, 0 on the right: from the middle on it is below the threshold.
    corners = np.array([[1, 0, 0], [1, 0, 1]], np.float32)
    columns = first_mask(replace(card, corner_alpha=corners)).any(axis=0)
    assert np.flatnonzero(columns).tolist() == [*range(16, 32)]


def test_a_holdout_hides_and_is_not_seen():
    snapshot = cards(Mask=(-1, 0, 1, 4), Wall=(0, 0, 50, 8))
    names = [o.name for o in snapshot.objects]
    is_mask = np.array([names[i] == "Mask" for i in snapshot.occurrence_object])
    snapshot = replace(
        snapshot, surface_holdout=is_mask[snapshot.surface_occurrence].astype(np.uint8)
    )
    grouping, result, ids = view_snapshot(snapshot)
    assert (result.buffers.instance[8:40, :32] == -1).all()
    assert np.isinf(result.buffers.depth_z_m[8:40, :32]).all()
    assert (result.buffers.instance == ids["Wall"]).sum() == 64 * 48 - 32 * 32
    assert unseen_reasons(snapshot, grouping, result) == {ids["Mask"]: "holdout"}


def test_every_reason_has_its_word():
    snapshot = cards(
        Wall=(0, 0, 5, 8), Hidden=(0, 0, 1, 9), Far=(0, 0, 500, 101), Behind=(0, 0, 1, -3),
        Beside=(40, 0, 1, 9), Flat=(0, 0, 0, 4), Tiny=(0.01, 0.01, 1e-4, 4),
    )  # fmt: skip
    grouping, result, ids = view_snapshot(snapshot)
    assert unseen_reasons(snapshot, grouping, result) == {
        ids["Hidden"]: "hidden",
        ids["Far"]: "beyond_clip_end",
        ids["Behind"]: "behind_camera",
        ids["Beside"]: "outside_view",
        ids["Flat"]: "no_area",
        ids["Tiny"]: "sub_pixel",
    }
