"""Silhouettes on an infinite picture, masks in one pass, and the order of layers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pycocotools import mask as coco_mask
from visibility.kernel_scenes import (
    jumble,
    only,
    pixel_camera,
    pixel_rectangle,
    place,
)

from legoworld.visibility.amodal import MOST_WHOLE_PX, Amodal
from legoworld.visibility.kernel import HOLDOUT, render
from legoworld.visibility.layers import amodal_layers, visible_areas

SIZE = (100, 100)
CAMERA = pixel_camera(SIZE)


def plate(x, side, z):
    """A square that faces the camera, its centre at (x, 0, z) metres."""
    u, v, half = 50 + 100 * x / z, 50, 50 * side / z
    return pixel_rectangle(CAMERA, u - half, v - half, u + half, v + half, z)


def amodal_of(surfaces, camera=CAMERA, size_wh=SIZE):
    layers = amodal_layers(surfaces, camera, size_wh)
    n = int(surfaces.placement_id.max()) + 1
    return Amodal(
        layers=layers, surfaces=surfaces, projection=camera, visible_px=visible_areas(layers, n)
    )


def counts(silhouette):
    return silhouette.in_frame_px, silhouette.visible_px, silhouette.whole_px


@pytest.mark.parametrize(
    ("moved_m", "plate_a", "plate_b", "edges"),
    [
        (0.0, (2500, 0, 2500), (2500, 2500, 2500), {0: {1: 2500}}),
        (0.25, (2500, 1250, 2500), (2500, 2500, 2500), {0: {1: 1250}}),
        (0.5, (2500, 2500, 2500), (1250, 1250, 2500), {}),
    ],
)
def test_two_plates(moved_m, plate_a, plate_b, edges):
    amodal = amodal_of(place([plate(0, 1, 2), plate(moved_m, 0.5, 1)]))
    a, b = amodal.silhouettes([0, 1])
    assert (counts(a), counts(b)) == (plate_a, plate_b)
    assert amodal.occluders.by_hidden() == amodal.direct_occluders.by_hidden() == edges
    assert a.visible_of_in_frame == plate_a[1] / 2500
    assert b.in_frame_of_whole == plate_b[0] / 2500
    assert b.visible_of_whole == b.visible_of_in_frame * b.in_frame_of_whole


def test_ten_millimetres_behind_a_sheet_is_hidden():
    """BOP calls it visible: up to 15 mm behind what is measured."""
    amodal = amodal_of(place([plate(0, 0.2, 0.5), plate(0, 0.1, 0.51)]))
    sheet, behind = amodal.silhouettes([0, 1])
    assert behind.visible_px == 0 < behind.in_frame_px
    assert sheet.visible_of_in_frame == 1


def test_the_whole_is_counted_beyond_a_canvas_of_three_pictures():
    amodal = amodal_of(place([plate(30, 40, 1)]))  # columns 1050 to 5050, rows -1950 to 2050
    (out_of_frame,) = amodal.silhouettes([0])
    assert counts(out_of_frame) == (0, 0, 4000 * 4000)
    assert out_of_frame.visible_of_in_frame is None
    assert out_of_frame.in_frame_of_whole == 0


def test_a_canvas_that_is_too_large_is_not_drawn():
    (large,) = amodal_of(place([plate(0, 90, 1)])).silhouettes([0])
    assert MOST_WHOLE_PX < 9000 * 9000
    assert counts(large) == (10_000, 10_000, None)
    assert large.unknown == "canvas_too_large"
    assert large.in_frame_of_whole is large.visible_of_whole is None
    assert large.visible_of_in_frame == 1.0


@pytest.mark.parametrize("far", [1e4, 1e12, 1e29])
def test_what_is_long_or_far_away_is_not_drawn(far):
    """In pieces it would take as many draws as it is long."""
    beam = np.array([[0, 0, 1], [far, 0, 1], [far, 0.01, 1], [0, 0.01, 1]], np.float32)
    corners = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    (one,) = amodal_of(place([(beam, corners)])).silhouettes([0])
    assert (one.whole_px, one.unknown) == (None, "canvas_too_large")
    away = beam + np.array([far, 0, 0], np.float32)
    (one,) = amodal_of(place([(away, corners)])).silhouettes([0])
    assert (one.in_frame_px, one.unknown) == (0, "canvas_too_large")


def test_a_floor_that_reaches_behind_the_camera_has_no_whole():
    floor = np.array([[-1, 1, -1], [1, 1, -1], [1, 1, 9], [-1, 1, 9]], np.float32)
    surfaces = place([(floor, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), plate(0, 0.5, 3)])
    crossing, behind = amodal_of(surfaces).silhouettes([0, 1])
    assert crossing.unknown == "crosses_near_plane"
    assert crossing.whole_px is crossing.in_frame_of_whole is None
    assert crossing.visible_of_in_frame is not None
    assert behind.unknown is None


def test_a_vertex_of_no_triangle_does_not_cross_the_near_plane():
    vertices, triangles = plate(0, 1, 2)
    loose = np.vstack([vertices, [[0, 0, -5]]]).astype(np.float32)
    (one,) = amodal_of(place([(loose, triangles)])).silhouettes([0])
    assert counts(one) == (2500, 2500, 2500)


def test_the_whole_is_the_picture_of_a_larger_frame():
    """Mirrored and sheared placements, cut-outs, instances of several parts."""
    compared = beyond = 0
    for seed in range(4):
        surfaces, camera, (width, height) = jumble(seed)
        amodal = amodal_of(surfaces, camera, (width, height))
        margin = 2000
        wide = replace(camera, cx=camera.cx + margin, cy=camera.cy + margin)
        size = (width + 2 * margin, height + 2 * margin)
        for ident, one in enumerate(amodal.silhouettes(range(10))):
            alone = render(only(surfaces, ident), wide, size).instance >= 0
            edges = alone[0], alone[-1], alone[:, 0], alone[:, -1]
            if one.whole_px is not None and not any(edge.any() for edge in edges):
                assert one.whole_px == alone.sum()
                compared += 1
                beyond += one.whole_px > one.in_frame_px > 0
    assert compared > 5
    assert beyond > 1


@pytest.mark.parametrize("seed", range(4))
def test_masks_in_one_pass_are_those_of_pycocotools(seed):
    amodal = amodal_of(*jumble(seed))
    ids = np.flatnonzero(amodal.in_frame_px).tolist()
    for ident, mask in zip(ids, amodal.layers.masks(ids), strict=True):
        np.testing.assert_array_equal(mask, amodal.layers.mask(ident))
        encoded = coco_mask.encode(np.asfortranarray(mask))
        assert amodal.masks.counts(ident) == encoded["counts"].decode()
        assert amodal.in_frame_px[ident] == mask.sum()
    assert amodal.layers.masks([HOLDOUT])[0].sum() == (amodal.layers.instance == HOLDOUT).sum()


def test_layers_of_plates_behind_each_other():
    plates = [plate(0, 1, 2), plate(0, 0.5, 1), plate(-0.9, 0.2, 2), plate(0, 2, 3)]
    order = amodal_of(place(plates)).order
    assert order.layer.tolist() == [1, 0, 0, 2]
    assert order.cycle(0) == ()


def test_three_bars_that_interlock_are_one_part():
    """Each passes over the next: no order can be forced on them."""
    bars = []
    for turn in range(3):
        angle = turn * 2 * np.pi / 3
        along, across = (
            np.array([np.cos(angle), np.sin(angle)]),
            np.array([-np.sin(angle), np.cos(angle)]),
        )
        # an edge of a triangle, its near end over the next bar and its far end under the last one
        middle = 0.15 * across
        corners = [
            (*(middle + s * 0.4 * along + w * 0.04 * across), 2 + s * 0.2)
            for s, w in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        bars.append((np.array(corners, np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32)))
    amodal = amodal_of(place([*bars, plate(0, 2, 4)]))
    assert {len(hiding) for hidden, hiding in amodal.direct_occluders.by_hidden().items()
            if hidden < 3} == {1}  # fmt: skip
    assert amodal.order.cycle(1) == (0, 1, 2)
    assert amodal.order.layer.tolist() == [0, 0, 0, 1]
    assert amodal.order.cycle(3) == ()
