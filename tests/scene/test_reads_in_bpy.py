"""Scenes as they are read inside Blender's own Python, with no file and no worker between."""

from __future__ import annotations

from typing import Any

import pytest
from scene.in_bpy import run_in_bpy

pytestmark = pytest.mark.blender


@pytest.fixture(scope="module")
def told() -> Any:
    return run_in_bpy("reads_in_bpy.py")


def test_objects_of_one_mesh_share_it_where_they_show_the_same_of_it(told):
    assert told["shared"]["surfaces"] == [
        ["Fifth", 2, False], ["First", 2, False], ["Fourth", 2, True], ["Second", 2, True]
    ]  # fmt: skip
    assert told["shared"]["meshes"] == 3  # one of both that are seen, and each holdout's own


def test_each_face_has_the_material_of_its_slot_or_of_the_last(told):
    assert told["slots"]["surfaces"] == [["Half", 2, False], ["Row", 2, True], ["Row", 4, False]]


def test_a_material_override_is_every_object_s_material(told):
    assert told["override there"]["surfaces"] == [["Bare", 2, False], ["Square", 2, False]]
    assert told["override gone"][0] == "no_mesh"


def test_what_renders_and_has_no_mesh_is_named(told):
    shown = [name for name, _, _ in told["types"]["surfaces"]]
    assert shown == ["Ball", "Square", "Text"]
    assert told["types"]["warnings"] == [
        "before", "greasepencil object 'Drawing' is not read: it has no mesh"
    ]  # fmt: skip


def test_adaptive_subdivision_is_read_at_its_render_level_and_said(told):
    assert told["adaptive"]["surfaces"] == [["Coarse", 8, False], ["Fine", 8, False]]
    assert told["adaptive"]["warnings"] == [
        "before", "object 'Fine' is subdivided adaptively: read at its fixed render level"
    ]  # fmt: skip


def test_labels_are_texts_and_numbers_of_objects_and_collections(told):
    assert told["labels"]["labels"] == {
        "Thing": {"category": "chair", "lvis_category": "7", "raw_category": "st\ufffdl"},
        "Mark": {"coco_category": "0.5"},
        "Outer": {"category": "room"},
    }
    assert told["labels"]["warnings"] == [
        "before", "'Thing' has a property 'odd_category' that is not text: not a label"
    ]  # fmt: skip
    assert told["labels"]["parents"] == {"Inner": ["Other", "Outer"], "Other": [], "Outer": []}
    held = told["labels"]["held"]
    assert held == {"Camera": [], "Mark": ["Other"], "Thing": ["Inner", "Other"]}


def test_the_first_view_layer_that_renders_is_read_and_what_else_there_is_said(told):
    assert told["layers"]["layer"] == ["Scene", "Second"]
    assert told["layers"]["camera"] == ["Main", ["Another", "Main"]]
    assert told["layers"]["warnings"] == [
        "before",
        "the file holds 2 scenes; read: 'Scene'",
        "the scene renders 2 view layers; read: 'Second'",
        "view layer 'Second' renders no surfaces: read with them",
    ]
    assert told["shared"]["warnings"] == ["before"]


def test_coordinates_may_be_as_large_as_is_said_and_no_larger(told):
    assert told["far"]["surfaces"] == [["Square", 2, False], ["Triangle", 1, False]]
    broken = [
        "non_finite_geometry", "mesh of object 'Triangle' has broken vertices",
        "2 of 3 vertices hold NaN, infinity or more than 1e+15",
    ]  # fmt: skip
    assert told["broken"]["vertices"] == told["broken"]["a NaN"] == broken
    assert told["broken"]["places"][:2] == ["non_finite_geometry", "object 'A' stands nowhere"]


def test_why_a_scene_has_no_picture(told):
    found = {name: (code, found) for name, (code, _, found) in told["broken"].items()}
    assert found["nothing"] == ("no_mesh", "1 objects, none with a visible face")
    assert found["no camera"] == ("no_camera", "no camera object")
    assert found["idle cameras"] == ("no_camera", "1 camera object, none active: Camera")
    assert found["an empty"] == ("no_camera", "empty object 'Mark'")


def test_cameras_that_can_be_read(told):
    can = [name for name, read in told["cameras"].items() if isinstance(read, dict)]
    assert can == ["plain", "clip just so", "small", "as far as can be"]
    assert {name: told["cameras"][name][::2] for name in ("panorama", "clip", "flat")} == {
        "panorama": ["unsupported_camera", "camera type PANO"],
        "clip": ["unsupported_camera", "clip_start 5, clip_end 5"],
        "flat": ["unsupported_camera", "a scale of 0"],
    }
    assert told["cameras"]["away"][0] == "non_finite_geometry"


def test_what_made_each_object_that_is_there(told):
    """A path of indices is all that Blender reports of it."""
    makers = ("Blower", "Bush", "Field", "Puff")
    assert told["instances"]["made"] == [
        "Blower", "Bush by Tree", "Camera", *(f"Chip by {maker}" for maker in makers for _ in "12"),
        *["Dot by Plate"] * 4, "Field", "Leaf by Twig", "Line", "Plate", "Puff by Tree",
        "Stem by Tree", "Tree", "Turned", "Twig by Tree", "Unused", "Wire by Tree",
    ]  # fmt: skip
    shown = [name for name, _, _ in told["instances"]["surfaces"]]
    assert shown == [
        "Blower", *["Chip"] * 8, *["Dot"] * 4, "Leaf", "Line", "Puff", "Stem", "Turned", "Wire"
    ]  # fmt: skip
    apart = {name: count for name, count in told["instances"]["apart"].items() if count > 1}
    assert apart == {"Chip": 8, "Dot": 4}


def test_a_surface_stands_where_its_object_does(told):
    placed = told["instances"]["placed"]
    assert placed["Turned"] == [[0, -3, 0, 5], [2, 0, 0, 6], [0, 0, 4, 7]]
    assert placed["Leaf"] == [[1, 0, 0, -40], [0, 1, 0, 30], [0, 0, 1, 0]]


def test_hair_and_points_are_seen_or_held_out_as_their_object_is(told):
    """By their material, or by the object; what is gone has no hair, too."""
    surfaces = told["thin"]["surfaces"]
    assert [[name, held_out] for name, _, held_out in surfaces] == [
        *[["Cloud", False]] * 2, *[["Cloud held out", True]] * 2, *[["Furry", False]] * 2,
        *[["Furry held out", True]] * 2, ["Furry of hair alone", False], ["Hair", False],
        ["Hair held out", True],
    ]  # fmt: skip
    fur = {triangles for name, triangles, _ in surfaces if name.startswith("Furry")} - {2}
    assert len(fur) == 1
    assert told["thin"]["warnings"] == ["before"]
