"""Rows 15 to 21 of the readout cases: what counts as one instance."""

from __future__ import annotations

import numpy as np
import pytest

pytestmark = pytest.mark.blender


def test_row_15_five_parts_are_one_instance_by_collection_empty_or_joined(cases):
    case = cases.read("five_parts")
    assert [c.area_px for c in case.of_category("chair")] == [500, 500, 500]
    assert case.bbox("Chair in a collection") == [10, 5, 58, 10]
    assert case.bbox("Chair under an empty") == [10, 20, 58, 10]
    assert case.bbox("Chair joined") == [10, 35, 58, 10]
    assert len(case.entries) == 3


def test_row_16_two_objects_that_share_a_mesh_are_two_instances(cases):
    case = cases.read("shared_mesh")
    assert len(case.scene.snapshot.vertex_start) == 2  # one mesh
    assert [c.area_px for c in case.of_category("chair")] == [100, 100]
    assert case.bbox("Chair") == [15, 25, 10, 10]
    assert case.bbox("Chair.001") == [55, 25, 10, 10]


def test_row_17_any_name_has_its_own_id_and_one_category(cases):
    case = cases.read("names")
    chairs = case.of_category("chair")
    assert {c.name for c in chairs} == {"Chair", "Chair.001", "椅子 🪑", "a/b\\c", 'say "x"'}
    assert sorted(c.id for c in chairs) == list(range(5))
    assert all(c.area_px == 64 for c in chairs)


def test_row_18_seventy_thousand_instances_are_all_distinct(cases):
    case = cases.read("seventy_thousand")
    apples = [i for i in case.grouping.instances if i.category and i.category.name == "apple"]
    assert len(apples) == 70_000
    assert (case.instance >= 0).all()
    assert len(np.unique(case.instance)) == 70_000
    assert (case.view.area_px[[a.id for a in apples]] == 1).all()


def test_row_19_a_collection_instanced_three_times_is_three_instances(cases):
    case = cases.read("collection_three_times")
    stools = case.of_category("chair")
    assert [s.area_px for s in stools] == [68, 68, 68]
    assert [s.bbox_xywh_px for s in stools] == [
        (11, 26, 8, 10), (36, 26, 8, 10), (61, 26, 8, 10)
    ]  # fmt: skip
    assert [s.id for s in stools] == [0, 1, 2]
    assert all(s.objects == ("Leg", "Seat") for s in stools)


def test_row_19_nested_collections_are_one_instance_per_placement(cases):
    case = cases.read("nested_collections")
    stools = case.of_category("chair")
    assert len(stools) == len(case.entries) == 6
    assert sorted(s.bbox_xywh_px for s in stools) == sorted(
        (33 + 5 * i, 13 + 30 * row, 4, 6) for i in range(3) for row in range(2)
    )


def test_row_19_labelled_objects_in_an_instanced_collection_are_one_per_placement(cases):
    case = cases.read("labelled_inside_a_collection")
    assert [a.area_px for a in case.of_category("apple")] == [16, 16, 16, 16]
    assert [b.area_px for b in case.named("Bowl")] == [144 - 32, 144 - 32]


def test_row_20_a_scattered_labelled_object_is_one_instance_each(cases):
    case = cases.read("scattered")
    apples = case.of_category("apple")
    assert [a.bbox_xywh_px for a in apples] == [(8 + 10 * i, 6, 4, 4) for i in range(3)]
    assert [a.area_px for a in apples] == [16, 16, 16]


def test_row_20_a_scattered_labelled_collection_is_one_instance_per_placement(cases):
    case = cases.read("scattered")
    stools = case.of_category("chair")
    assert [s.area_px for s in stools] == [20] * 4
    assert all(s.objects == ("Leg", "Seat") for s in stools)


def test_row_20_members_picked_from_a_labelled_collection_are_one_instance_each(cases):
    case = cases.read("scattered")
    stones = case.of_category("stone")
    assert len(stones) == 4
    assert sorted(s.area_px for s in stones) == [16, 16, 36, 36]
    assert all(len(s.objects) == 1 for s in stones)


def test_row_20_a_label_on_the_scatterer_only_is_one_instance(cases):
    case = cases.read("scattered")
    (bush,) = case.of_category("bush")
    assert bush.area_px == 3 * 16
    assert bush.bbox_xywh_px == (8, 48, 24, 4)


def test_row_20_particles_are_one_instance_each_by_object_and_by_collection(cases):
    case = cases.read("particles")
    for name, side, x in (("apple", 4, 10), ("chair", 6, 50)):
        corners = [(x + dx, y) for dx in (0, 20) for y in (10, 50)]
        boxes = sorted(m.bbox_xywh_px for m in case.of_category(name))
        assert boxes == [(cx - side // 2, cy - side // 2, side, side) for cx, cy in corners]
        assert [m.area_px for m in case.of_category(name)] == [side * side] * 4
    assert all(m.objects == ("Leg", "Seat") for m in case.of_category("chair"))


def test_row_20_vertex_duplicates_belong_to_a_labelled_parent_or_count_each(cases):
    case = cases.read("vertex_duplicates")
    (tree,) = case.of_category("tree")
    assert tree.area_px == 3 * 36
    assert [a.area_px for a in case.of_category("apple")] == [36, 36, 36]


def test_row_21_curves_text_and_metaballs_are_meshed(cases):
    case = cases.read("kinds")
    (curve,) = case.of_category("curve")
    assert (curve.area_px, curve.bbox_xywh_px) == (64, (10, 12, 8, 8))
    (text,) = case.of_category("text")
    assert text.area_px > 10
    assert text.bbox_xywh_px[3] > 3 * text.bbox_xywh_px[2]
    (ball,) = case.of_category("ball")
    x, y, w, h = ball.bbox_xywh_px
    assert (2 * x + w, 2 * y + h) == (120, 40)
    assert w == h
    assert 0.8 < ball.area_px / (np.pi * (w / 2) ** 2) < 1.0  # a coarse ball
    assert case.warnings == ()


def test_row_21_hair_and_points_are_as_wide_as_their_radius_and_belong_to_their_object(cases):
    case = cases.read("kinds")
    (hair,) = case.of_category("hair")
    assert (hair.area_px, hair.bbox_xywh_px) == (16 * 4, (20, 48, 16, 4))
    assert set(case.depth[case.mask("Hair")].tolist()) == {100.0}
    (cat,) = case.of_category("cat")
    assert cat.objects == ("Furry",)
    assert (cat.area_px, cat.bbox_xywh_px) == (2 * 12 * 4, (50, 39, 12, 12))
    (cloud,) = case.of_category("cloud")
    centres = np.arange(-6, 6) + 0.5
    disc = int((centres[:, None] ** 2 + centres**2 < 25).sum())
    assert (cloud.area_px, cloud.bbox_xywh_px) == (2 * disc, (5, 30, 22, 10))
    nearest = case.depth[case.mask("Cloud")].min()
    assert abs(nearest - (100 - np.sqrt(25 - 0.5))) < 1e-3
