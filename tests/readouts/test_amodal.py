"""Amodal results of one image: masks, fractions, occluders and order, of plates known by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pycocotools import mask as coco_mask
from readouts.quads import SQUARE, at, quads
from visibility.kernel_scenes import jumble, pixel_camera, pixel_rectangle, place

from legoworld.cards import load_card
from legoworld.readouts.amodal import amodal_exports
from legoworld.readouts.detection import READOUT
from legoworld.readouts.family import AnsweredImage
from legoworld.records.base import canonical
from legoworld.scene.instances import Instance
from legoworld.tracks.vocabulary import Category
from legoworld.visibility.amodal import MOST_SIDE_PX, MOST_WHOLE_PX
from legoworld.visibility.kernel import HOLDOUT, render
from legoworld.visibility.layers import MAX_ENTRIES, amodal_areas, direct_occluders, occluders
from legoworld.visibility.runs import instance_extents
from legoworld.visibility.view import View

SIZE = (100, 100)
CAMERA = pixel_camera(SIZE)


def plate(x, side, z):
    u, v, half = 50 + 100 * x / z, 50, 50 * side / z
    return pixel_rectangle(CAMERA, u - half, v - half, u + half, v + half, z)


def view_of(surfaces, camera=CAMERA, size_wh=SIZE):
    n = max(int(surfaces.placement_id.max()) + 1, 0)
    buffers = render(surfaces, camera, size_wh)
    area, extents = instance_extents(buffers.instance, n)
    return View(
        snapshot=quads(("none", SQUARE, at(0, 0, 0))),  # what is drawn is in the surfaces
        size_wh=size_wh, projection=camera, surfaces=surfaces, depth_scale=1.0, buffers=buffers,
        area_px=area, bbox_xyxy_px=extents,
    )  # fmt: skip


def export_entries(view, *category_ids, threads=None):
    """Results as JSON has them."""
    instances = [
        Instance(
            id=i, name=str(i), objects=(str(i),), label_text=None,
            category=None if c is None else Category(id=c, name=str(c)),
        )
        for i, c in enumerate(category_ids)
    ]  # fmt: skip
    image = AnsweredImage(
        image_id=3, name="a", run=Path(), instances=instances, view=view, threads=threads
    )
    exports = amodal_exports(image)
    assert READOUT.exports("amodal", image) == exports
    return json.loads(canonical([prediction for prediction, _ in exports]))


def plates(moved_m, *category_ids):
    return export_entries(view_of(place([plate(0, 1, 2), plate(moved_m, 0.5, 1)])), *category_ids)


def test_a_plate_that_another_hides_is_exported():
    b, a = plates(0, 9, 5)
    assert (a["category_id"], a["instance"], b["instance"]) == (9, 0, 1)
    assert a["bbox"] == b["bbox"] == b["inmodal_bbox"] == [25, 25, 50, 50]
    assert a["inmodal_bbox"] == [0, 0, 0, 0]
    assert coco_mask.area(a["segmentation"]) == 2500
    assert coco_mask.area(a["visible_mask"]) == 0
    assert a["occlude_rate"] == 1
    assert a["visible_of_in_frame"] == a["visible_of_whole"] == 0
    assert a["in_frame_of_whole"] == 1
    assert a["occluded_by"] == a["directly_occluded_by"] == [[1, 2500]]
    assert b["occluded_by"] == b["cycle"] == []
    assert (a["layer"], b["layer"]) == (1, 0)
    assert {a["score"], b["score"]} == {1.0}
    assert a["image_id"] == 3
    assert "whole_unknown" not in a


@pytest.mark.parametrize(
    ("moved_m", "of_a", "of_b", "edges"),
    [(0.25, (0.5, 1, 0.5), (1, 1, 1), [[1, 1250]]), (0.5, (1, 1, 1), (1, 0.5, 0.5), [])],
)
def test_plates_side_by_side(moved_m, of_a, of_b, edges):
    a, b = plates(moved_m, 5, 9)
    names = "visible_of_in_frame", "in_frame_of_whole", "visible_of_whole"
    assert tuple(a[n] for n in names) == of_a
    assert tuple(b[n] for n in names) == of_b
    assert a["occlude_rate"] == 1 - of_a[0]
    assert a["occluded_by"] == edges


def test_the_card_has_the_fields_of_a_result():
    fields = load_card("amodal").value("export.fields")
    assert all(sorted(result) == sorted(fields) for result in plates(0.25, 5, 9))


def test_the_card_has_the_limits_of_the_code():
    card = load_card("amodal")
    assert card.value("export.most_whole_px") == MOST_WHOLE_PX
    assert card.value("export.most_whole_side_px") == MOST_SIDE_PX
    assert card.value("export.most_layer_px") == MAX_ENTRIES


def test_what_is_unlabelled_is_one_node_and_holdouts_belong_to_it():
    shapes = [plate(0, 2, 4), plate(-0.2, 0.2, 1), plate(0.2, 0.2, 1), plate(0, 0.1, 1)]
    surfaces = place(shapes)
    surfaces = replace(
        surfaces,
        placement_id=np.where(surfaces.placement_id == 3, HOLDOUT, surfaces.placement_id),
    )
    (wall,) = export_entries(view_of(surfaces), 5, None, None)
    assert wall["occluded_by"] == [[None, 20 * 15 + 20 * 15 + 100]]
    assert wall["layer"] == 1


def test_an_instance_under_the_camera_has_no_whole_and_says_so():
    floor = np.array([[-1, 1, -1], [1, 1, -1], [1, 1, 9], [-1, 1, 9]], np.float32)
    corners = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    (one,) = export_entries(view_of(place([(floor, corners)])), 5)
    assert one["in_frame_of_whole"] is one["visible_of_whole"] is None
    assert one["visible_of_in_frame"] == 1
    assert one["whole_unknown"] == "crosses_near_plane"


def test_two_plates_that_pass_through_each_other_are_a_cycle():
    tilted = [
        (np.array([[-0.4, y, 2 + s], [0.4, y, 2 - s], [0.4, 0.3, 2 - s], [-0.4, 0.3, 2 + s]],
                  np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))
        for y, s in ((-0.3, 0.2), (-0.2, -0.2))
    ]  # fmt: skip
    a, b = export_entries(view_of(place(tilted)), 5, 6)
    assert a["cycle"] == b["cycle"] == [0, 1]
    assert a["layer"] == b["layer"] == 0
    assert a["occluded_by"][0][0] == 1
    assert b["occluded_by"][0][0] == 0


@pytest.mark.parametrize("seed", range(4))
def test_pixels_are_conserved_and_threads_change_nothing(seed):
    """Mirrored and sheared placements, cut-outs, holdouts, ties; some instances unlabelled."""
    surfaces, camera, size_wh = jumble(seed)
    view = view_of(surfaces, camera, size_wh)
    categories = [5 if i % 3 else None for i in range(len(view.area_px))]
    results = export_entries(view, *categories, threads=1)
    assert export_entries(view, *categories, threads=4) == results
    layers = view.amodal().layers
    area = amodal_areas(layers, len(categories))
    assert [r["instance"] for r in sorted(results, key=lambda r: r["instance"])] == [
        i for i, c in enumerate(categories) if c and area[i]
    ]
    for result in results:
        ident = result["instance"]
        hidden = area[ident] - view.area_px[ident]
        assert coco_mask.area(result["segmentation"]) == area[ident]
        assert coco_mask.area(result["visible_mask"]) == view.area_px[ident]
        for key, pairs in (("occluded_by", occluders(layers)),
                           ("directly_occluded_by", direct_occluders(layers))):  # fmt: skip
            assert sum(count for _, count in result[key]) == hidden
            own = pairs.by_hidden().get(ident, {})
            assert all(own[j] == count for j, count in result[key] if j is not None)
    keys = [(r["category_id"], r["segmentation"]["counts"]) for r in results]
    assert keys == sorted(keys)


def test_a_picture_of_nothing_has_no_results():
    assert export_entries(view_of(place([plate(40, 0.5, 1)])), 5) == []
