"""Rows 1 to 14 and 26 of the readout cases: which pixels, at which depth."""

from __future__ import annotations

import numpy as np
import pytest
from pycocotools import mask as coco_mask

from legoworld.readouts.exports import bbox_xywh_px, mask_exports
from legoworld.records.base import as_json

pytestmark = pytest.mark.blender


def test_row_01_a_plane_facing_the_camera_has_one_depth_everywhere(cases):
    assert (cases.read("facing_plane").depth == 5.0).all()
    assert (cases.read("facing_plane", (37, 91)).depth == 5.0).all()


def test_row_02_depth_inside_a_sphere_is_planar_and_not_the_rays_length(cases):
    case = cases.read("inside_a_sphere")
    p = case.view.projection
    rows, columns = np.indices(case.depth.shape) + 0.5
    x, y = (columns - p.cx) / p.fx, (rows - p.cy) / p.fy
    cosine = 1.0 / np.sqrt(1.0 + x * x + y * y)
    assert cosine.min() < 0.72
    # The sphere of faces lies between the true one and one whose faces it touches from outside.
    flattest = np.cos(np.pi / 128) * np.cos(np.pi / 128)
    ratio = case.depth / (10.0 * cosine)
    assert ratio.max() <= 1.0 + 5e-6  # vertices are float32
    assert ratio.min() >= flattest * flattest


def test_row_03_nothing_hit_is_infinitely_far_and_no_instance(cases):
    case = cases.read("a_small_quad")
    missed = case.instance == -1
    assert int(missed.sum()) == 80 * 60 - 1600
    assert np.isposinf(case.depth[missed]).all()
    assert (case.depth[~missed] == 100.0).all()


def test_row_04_a_quad_over_columns_and_rows_10_to_49(cases):
    case = cases.read("a_small_quad")
    assert case.area("Quad") == 1600
    assert case.bbox("Quad") == [10, 10, 40, 40]


def test_row_05_a_left_edge_just_before_or_after_a_pixel_centre(cases):
    case = cases.read("left_edges")
    assert case.bbox("In") == [10, 5, 10, 10]
    assert case.bbox("Out") == [11, 20, 9, 10]
    assert case.bbox("On") == [10, 35, 10, 10]  # edges are inclusive


def test_row_06_an_object_at_the_top_of_the_picture_has_a_small_y(cases):
    case = cases.read("at_the_top")
    assert case.bbox("Top") == [30, 2, 20, 4]
    assert case.bbox("Left") == [1, 20, 3, 20]


def test_row_07_a_rings_hole_is_not_in_its_mask(cases):
    case = cases.read("ring")
    ((prediction, _),) = mask_exports(1, case.grouping.instances, case.view)
    rle = as_json(prediction)["segmentation"]
    encoded = {"size": rle["size"], "counts": rle["counts"].encode()}
    assert case.area("Ring") == 1200
    assert int(coco_mask.area(encoded)) == 1200
    assert list(rle["size"]) == [60, 80]
    assert np.array_equal(coco_mask.decode(encoded).astype(bool), case.mask("Ring"))
    assert case.bbox("Ring") == [10, 10, 40, 40]
    assert (case.instance[20:40, 20:40] == -1).all()


def test_row_08_an_occluder_splits_an_object_into_one_annotation(cases):
    case = cases.read("split_by_an_occluder")
    (bar,) = case.of_category("bar")
    assert bar.area_px == 500
    assert bar.bbox_xywh_px == (10, 20, 60, 10)
    assert case.area("Post") == 500


def test_row_09_one_pixel_objects_and_lines_are_kept(cases):
    case = cases.read("one_pixel_wide")
    assert (case.area("Dot"), case.bbox("Dot")) == (1, [12, 7, 1, 1])
    assert (case.area("Row"), case.bbox("Row")) == (40, [20, 10, 40, 1])
    assert (case.area("Column"), case.bbox("Column")) == (30, [15, 20, 1, 30])


def test_row_10_what_is_not_seen_has_a_reason(cases):
    case = cases.read("unseen")
    reasons = {entry.name: entry.reason for entry in case.entries}
    assert reasons == {
        "Wall": None,
        "Hidden": "hidden",
        "Behind": "behind_camera",
        "Outside": "outside_view",
        "Beyond": "beyond_clip_end",
        "Sub-pixel": "sub_pixel",
        "Line": "no_area",
    }
    assert all(entry.area_px == 0 for entry in case.of_category("thing"))


def test_row_11_boxes_end_at_the_border(cases):
    case = cases.read("cut_by_the_border")
    assert case.bbox("Corner") == [0, 0, 8, 5]
    assert case.bbox("Right") == [70, 20, 10, 20]
    assert case.bbox("Bottom") == [30, 55, 10, 5]
    assert case.area("Corner") == 40


def test_row_12_clip_planes_cut_and_show_what_lies_behind(cases):
    case = cases.read("clip_planes")
    assert case.one("Before clip start").reason == "behind_camera"
    assert case.one("Past clip end").reason == "beyond_clip_end"
    assert case.area("Seen") == 60 * 40
    assert (case.depth[case.mask("Seen")] == 100.0).all()
    assert case.area("At clip start") == case.area("At clip end") == 25  # planes are inclusive


def test_row_13_visible_masks_partition_what_is_hit(cases):
    case = cases.read("crowd")
    areas = sum(entry.area_px for entry in case.entries)
    hit = case.instance >= 0
    assert areas == int(hit.sum())
    assert np.array_equal(np.isfinite(case.depth), hit)
    assert (case.depth[hit] > 0).all()
    for entry in case.entries:
        mask = case.instance == entry.id
        assert int(mask.sum()) == entry.area_px
        if mask.any():
            rows, columns = np.nonzero(mask)
            x, y, w, h = bbox_xywh_px(case.view, entry.id)
            assert (columns.min(), columns.max() + 1) == (x, x + w)
            assert (rows.min(), rows.max() + 1) == (y, y + h)


def test_row_14_coplanar_faces_go_to_the_lower_id_for_any_number_of_threads(cases):
    case = cases.read("coplanar")
    assert case.one("A first").id < case.one("Z last").id
    assert case.area("A first") == 40 * 20
    assert case.area("Z last") == 40 * 40 - 30 * 20
    for threads in (1, 2, 16):
        again = cases.read("coplanar", threads=threads)
        assert again.instance.tobytes() == case.instance.tobytes()
        assert again.depth.tobytes() == case.depth.tobytes()


def test_row_26_a_concave_n_gon_has_its_exact_area(cases):
    case = cases.read("concave")
    assert case.area("L") == 10 * 40 + 30 * 10
    assert (case.instance[10:40, 20:50] == -1).all()
