"""Who owns a surface: own label, then parents, then collections, then what instanced it."""

from __future__ import annotations

import numpy as np
import pytest
from scene.by_hand import VOCABULARY, HandScene, categories, outside, summary

from legoworld.scene.instances import group
from legoworld.scene.labels import Labels, resolve_labels


def test_every_unlabelled_occurrence_is_an_instance_of_its_own():
    scene = HandScene()
    scene.object("A")
    scene.object("B")
    scene.occurs("A", surfaces=2)
    scene.occurs("B")
    grouping = scene.grouped()
    assert summary(grouping) == [("A", None, ("A",)), ("B", None, ("B",))]
    assert grouping.surface_instance.tolist() == [0, 0, 1]


def test_the_objects_own_label_wins_over_parent_collection_and_instancer():
    scene = HandScene()
    scene.collection("In", category="tree")
    scene.object("Empty", kind="EMPTY", makes="COLLECTION", category="dining table")
    scene.object("Parent", category="chair", collections=("In",))
    scene.object("Part", parent="Parent", collections=("In",), category="apple")
    empty = scene.occurs("Empty", surfaces=0)
    scene.occurs("Part", by=empty)
    assert categories(scene.grouped()) == ["apple"]


def test_the_parents_label_wins_over_collection_and_instancer():
    scene = HandScene()
    scene.collection("In", category="tree")
    scene.object("Empty", kind="EMPTY", makes="COLLECTION", category="dining table")
    scene.object("Parent", category="chair", collections=("In",))
    scene.object("Part", parent="Parent", collections=("In",))
    empty = scene.occurs("Empty", surfaces=0)
    scene.occurs("Part", by=empty)
    assert summary(scene.grouped()) == [("Parent", "chair", ("Part",))]


def test_the_collections_label_wins_over_the_instancers():
    scene = HandScene()
    scene.collection("In", category="tree")
    scene.object("Empty", kind="EMPTY", makes="COLLECTION", category="dining table")
    scene.object("Part", collections=("In",))
    empty = scene.occurs("Empty", surfaces=0)
    scene.occurs("Part", by=empty)
    assert summary(scene.grouped()) == [("In", "tree", ("Part",))]


def test_the_innermost_collection_wins():
    scene = HandScene()
    scene.collection("Outer", category="tree")
    scene.collection("Middle", "Outer")
    scene.collection("Inner", "Middle", category="chair")
    scene.object("A", collections=("Inner",))
    scene.object("B", collections=("Middle",))
    scene.occurs("A")
    scene.occurs("B")
    grouping = scene.grouped()
    assert summary(grouping) == [("Inner", "chair", ("A",)), ("Outer", "tree", ("B",))]
    assert grouping.enclosing_instance == {0: 1}


def test_the_instancers_label_counts_last_and_once_for_all_it_made():
    scene = HandScene()
    scene.object("Scatterer", category="tree")
    scene.object("Leaf")
    scatterer = scene.occurs("Scatterer")
    for frame in range(3):
        scene.occurs("Leaf", by=scatterer, frame=frame)
    assert summary(scene.grouped()) == [("Scatterer", "tree", ("Leaf", "Scatterer"))]


def test_a_labelled_object_is_one_instance_per_placement():
    scene = HandScene()
    scene.object("Scatterer")
    scene.object("Fruit", category="apple")
    scatterer = scene.occurs("Scatterer")
    for frame in range(3):
        scene.occurs("Fruit", by=scatterer, frame=frame)
    assert categories(scene.grouped()) == [None, "apple", "apple", "apple"]


def test_a_labelled_object_on_a_labelled_scatterer_is_nested_in_it():
    scene = HandScene()
    scene.object("Scatterer", category="tree")
    scene.object("Fruit", category="apple")
    scatterer = scene.occurs("Scatterer")
    scene.occurs("Fruit", by=scatterer, frame=0)
    scene.occurs("Fruit", by=scatterer, frame=1)
    assert scene.grouped().enclosing_instance == {1: 0, 2: 0}


def test_a_labelled_empty_owns_all_its_descendants():
    scene = HandScene()
    scene.object("Root", kind="EMPTY", category="chair")
    scene.object("Frame", kind="EMPTY", parent="Root")
    scene.object("Leg", parent="Frame")
    scene.object("Seat", parent="Root")
    scene.occurs("Leg")
    scene.occurs("Seat")
    assert summary(scene.grouped()) == [("Root", "chair", ("Leg", "Seat"))]


def test_a_labelled_descendant_is_cut_out_of_its_ancestor():
    scene = HandScene()
    scene.object("Table", category="dining table")
    scene.object("Bowl", parent="Table")
    scene.object("Apple", parent="Bowl", category="apple")
    for name in ("Table", "Bowl", "Apple"):
        scene.occurs(name)
    grouping = scene.grouped()
    assert summary(grouping) == [
        ("Table", "dining table", ("Bowl", "Table")),
        ("Apple", "apple", ("Apple",)),
    ]
    assert grouping.enclosing_instance == {1: 0}


def test_the_parent_chain_leads_across_hidden_parents():
    scene = HandScene()
    scene.object("Root", category="chair")  # occurs nowhere: hidden from rendering
    scene.object("Hidden", parent="Root")
    scene.object("Leg", parent="Hidden")
    scene.object("Seat", parent="Root")
    scene.occurs("Leg")
    scene.occurs("Seat")
    assert summary(scene.grouped()) == [("Root", "chair", ("Leg", "Seat"))]


def test_a_parent_left_out_of_an_instanced_collection_still_owns_its_parts_per_placement():
    scene = HandScene()
    scene.object("Empty", kind="EMPTY", makes="COLLECTION")
    scene.object("Root", kind="EMPTY", category="chair")
    scene.object("Leg", parent="Root")
    scene.object("Seat", parent="Root")
    for _ in range(2):
        empty = scene.occurs("Empty", surfaces=0)
        scene.occurs("Leg", by=empty)
        scene.occurs("Seat", by=empty)
    assert summary(scene.grouped()) == [("Root", "chair", ("Leg", "Seat"))] * 2


def test_a_loop_of_parents_ends():
    scene = HandScene()
    scene.object("A")
    scene.object("B", parent="A")
    first = scene.objects[0]
    scene.objects[0] = type(first)(**{**vars(first), "parent": 1})
    scene.occurs("A")
    scene.occurs("B")
    assert categories(scene.grouped()) == [None, None]


def test_a_labelled_collection_is_one_instance_of_everything_in_it():
    scene = HandScene()
    scene.collection("Set", category="dining table")
    scene.collection("Cutlery", "Set")
    scene.object("Top", collections=("Set",))
    scene.object("Fork", collections=("Cutlery",))
    scene.occurs("Top")
    scene.occurs("Fork")
    assert summary(scene.grouped()) == [("Set", "dining table", ("Fork", "Top"))]


def test_a_labelled_collection_is_one_instance_per_placement():
    scene = HandScene()
    scene.collection("Set", category="dining table")
    scene.object("Top", collections=("Set",))
    scene.object("Leg", collections=("Set",))
    scene.object("Empty", kind="EMPTY", makes="COLLECTION")
    for name in ("Top", "Leg"):
        scene.occurs(name)
    for _ in range(3):
        empty = scene.occurs("Empty", surfaces=0)
        scene.occurs("Top", by=empty)
        scene.occurs("Leg", by=empty)
    grouping = scene.grouped()
    assert summary(grouping) == [("Set", "dining table", ("Leg", "Top"))] * 4
    assert grouping.surface_instance.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


def test_a_labelled_collection_nested_in_instanced_ones_is_one_instance_per_placement():
    scene = HandScene()
    scene.collection("Room")
    scene.collection("Chair", category="chair")
    scene.object("Seat", collections=("Chair",))
    scene.object("Leg", collections=("Chair",))
    scene.object("Place", kind="EMPTY", makes="COLLECTION", collections=("Room",))
    scene.object("House", kind="EMPTY", makes="COLLECTION")
    for _ in range(2):
        house = scene.occurs("House", surfaces=0)
        for _ in range(3):
            place = scene.occurs("Place", by=house, surfaces=0)
            scene.occurs("Seat", by=place)
            scene.occurs("Leg", by=place)
    assert summary(scene.grouped()) == [("Chair", "chair", ("Leg", "Seat"))] * 6


@pytest.mark.parametrize("held_by", ["Oak", "Wood", "Bark"])
def test_a_collection_that_holds_its_own_instancer_is_one_instance(held_by):
    """In itself, or in a collection within it."""
    scene = HandScene()
    scene.collection("Oak", category="tree")
    scene.collection("Wood", "Oak")
    scene.collection("Bark", "Wood")
    scene.object("Trunk", makes="VERTS", collections=(held_by,))
    scene.object("Leaf", collections=("Oak",))
    trunk = scene.occurs("Trunk")
    for frame in range(5):
        scene.occurs("Leaf", by=trunk, frame=frame)
    assert summary(scene.grouped()) == [("Oak", "tree", ("Leaf", "Trunk"))]


def test_vertex_duplicates_of_a_labelled_parent_are_one_instance():
    scene = HandScene()
    scene.object("Tree", makes="VERTS", category="tree")
    scene.object("Leaf", parent="Tree")
    scene.object("Vein", parent="Leaf")
    tree = scene.occurs("Tree")
    for frame in range(4):
        scene.occurs("Leaf", by=tree, frame=frame)
        scene.occurs("Vein", by=tree, frame=frame)
    assert summary(scene.grouped()) == [("Tree", "tree", ("Leaf", "Tree", "Vein"))]


def test_an_ancestor_of_the_vertex_instancer_owns_its_duplicates():
    scene = HandScene()
    scene.object("Garden", kind="EMPTY", category="tree")
    scene.object("Branch", makes="VERTS", parent="Garden")
    scene.object("Leaf", parent="Branch")
    branch = scene.occurs("Branch")
    for frame in range(4):
        scene.occurs("Leaf", by=branch, frame=frame)
    assert summary(scene.grouped()) == [("Garden", "tree", ("Branch", "Leaf"))]


def test_a_duplicates_own_collection_counts_before_the_instancers():
    scene = HandScene()
    scene.collection("Fruit", category="apple")
    scene.collection("Wood", category="tree")
    scene.object("Branch", makes="VERTS", collections=("Wood",))
    scene.object("Apple", parent="Branch", collections=("Fruit",))
    branch = scene.occurs("Branch")
    for frame in range(2):
        scene.occurs("Apple", by=branch, frame=frame)
    assert categories(scene.grouped()) == ["tree", "apple", "apple"]


def test_a_labelled_duplicate_parent_owns_the_parts_on_its_own_vertex():
    scene = HandScene()
    scene.object("Field", makes="VERTS")
    scene.object("Plant", parent="Field", category="tree")
    scene.object("Pot", parent="Plant")
    field = scene.occurs("Field")
    for frame in range(3):
        scene.occurs("Plant", by=field, frame=frame)
        scene.occurs("Pot", by=field, frame=frame)
    assert summary(scene.grouped())[1:] == [("Plant", "tree", ("Plant", "Pot"))] * 3


def test_several_labelled_collections_are_taken_by_name_with_one_warning():
    scene = HandScene()
    scene.collection("B set", category="apple")
    scene.collection("A set", category="chair")
    for name in ("One", "Two", "Three"):
        scene.object(name, collections=("B set", "A set"))
        scene.occurs(name)
    grouping = scene.grouped()
    assert summary(grouping) == [("A set", "chair", ("One", "Three", "Two"))]
    assert grouping.warnings == (
        "'One' and 2 more lie in 2 labelled collections; 'A set' was taken",
    )


def test_a_label_outside_the_vocabulary_is_transparent_and_counted():
    scene = HandScene()
    scene.object("Car", category="chair")
    scene.object("Wheel 1", parent="Car", category="wheel")
    scene.object("Wheel 2", parent="Car", category="wheel")
    for name in ("Car", "Wheel 1", "Wheel 2"):
        scene.occurs(name)
    grouping = scene.grouped()
    assert summary(grouping) == [("Car", "chair", ("Car", "Wheel 1", "Wheel 2"))]
    assert grouping.outside_vocabulary == {"wheel": 2}
    assert grouping.enclosing_instance == {}


def test_without_a_vocabulary_every_label_counts_as_it_is_written():
    scene = HandScene()
    scene.object("Car", category="My Car")
    scene.object("Wheel", parent="Car", category="wheel")
    scene.occurs("Car")
    scene.occurs("Wheel")
    grouping = scene.grouped(vocabulary=None, override=None)
    assert categories(grouping) == ["My Car", "wheel"]
    assert grouping.enclosing_instance == {1: 0}


def test_labelled_owners_without_a_surface_are_named():
    scene = HandScene()
    scene.collection("Store", category="apple")
    scene.object("Shown", category="chair")
    scene.object("Hidden", category="tree")
    scene.occurs("Shown")
    scene.collection("Shelf", category="apple")
    scene.object("Pear", collections=("Shelf",))
    scene.occurs("Pear")
    assert scene.grouped().unseen_owners == (("Hidden", "tree"), ("Store", "apple"))


def test_objects_that_share_a_mesh_are_instances_of_their_own():
    scene = HandScene()
    scene.object("Chair", category="chair")
    scene.object("Chair.001", category="chair")
    scene.occurs("Chair")
    scene.occurs("Chair.001")
    assert categories(scene.grouped()) == ["chair", "chair"]


def test_ids_follow_the_order_of_surfaces_and_not_of_labels():
    scene = HandScene()
    for name in ("A", "B", "C"):
        scene.object(name)
        scene.occurs(name)
    labels = resolve_labels(
        scene.snapshot(),
        [outside("object", "C", category="chair"), outside("object", "A", category="apple")],
        VOCABULARY,
        None,
    )
    turned = Labels(objects=dict(reversed(labels.objects.items())), collections={}, warnings=())
    one, other = group(scene.snapshot(), labels), group(scene.snapshot(), turned)
    assert summary(one) == summary(other)
    assert np.array_equal(one.surface_instance, other.surface_instance)
    assert categories(one) == ["apple", None, "chair"]
