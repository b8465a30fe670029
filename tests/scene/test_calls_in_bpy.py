"""Walks, renders, programs and endpoint calls inside Blender's own Python, without a worker."""

from __future__ import annotations

from typing import Any

import pytest
from scene.in_bpy import run_in_bpy

pytestmark = pytest.mark.blender


@pytest.fixture(scope="module")
def told() -> Any:
    return run_in_bpy("calls_in_bpy.py")


def test_the_camera_sees_an_instance_where_it_sees_it_and_its_instancer(told):
    shown = [name for name in told["camera visibility"] if name.startswith("part")]
    assert shown == ["part True, whole True"]


def test_indirect_only_hides_what_is_no_holdout(told):
    shown = [name for name in told["camera visibility"] if name.startswith("holdout")]
    assert shown == [
        "holdout False, indirect False",
        "holdout True, indirect False held out",
        "holdout True, indirect True held out",
    ]


def test_a_picture_has_the_scene_s_size_and_1024_pixels_a_side_at_most(told):
    assert told["pictures"]["sizes"] == [[6, 4], [8, 6], [1024, 8], [8, 1024]]


def test_a_picture_is_the_same_whatever_the_scene_would_render_with(told):
    pictures = told["pictures"]["contents"]
    plain = pictures.pop("")
    assert [name for name in pictures if pictures[name] != plain] == ["strength of the light"]


def test_a_program_runs_as_blender_would_run_it(told):
    programs = told["programs"]
    for name in ("its words", "quits", "exits", "exits with 0"):
        assert programs[name] == [None, []]
    assert programs["renders"] == [None, ["render", "render"]]


def test_a_program_s_error_has_its_line_and_words(told):
    found = {name: error for name, (error, _) in told["programs"].items() if error}
    assert found == {
        "exits with 3": ["SystemExit 3", "the program ended itself with exit code 3", 2],
        "exits with words": [
            "SystemExit no light", "the program ended itself with exit code 1: no light", 3
        ],
        "raises": ["ValueError", "far program.py", 2],
        "does not compile": ["SyntaxError", "invalid syntax (program.py, line 2)", 2],
        "has no words": ["E", "an error whose text cannot be made: TypeError", 4],
    }  # fmt: skip


def test_an_endpoint_describes_an_object(told):
    plain = {"location": [0, 0, 0], "rotation": [0, 0, 0], "scale": [1, 1, 1], "materials": []}
    assert told["endpoint"]["lamp"] == {**plain, "name": "Lamp", "type": "LIGHT", "visible": False}
    table = told["endpoint"]["table"]
    assert table.pop("location") == pytest.approx([1.234, 0, 5])
    low, high = table.pop("world_bounding_box")
    assert low == pytest.approx([-78.766, 28, 5])
    assert high == pytest.approx([-70.766, 30, 5])
    assert table == {
        "name": "Table", "type": "MESH", "rotation": [0, 0, 0], "scale": [2, 1, 1],
        "visible": True, "materials": ["Oak"], "mesh": {"vertices": 4, "edges": 4, "polygons": 1},
    }  # fmt: skip


def test_an_endpoint_describes_the_scene_by_its_first_ten_objects(told):
    scene = told["endpoint"]["scene"]
    assert scene.pop("objects")[0] == {"name": "Table", "type": "MESH", "location": [1.23, 0, 5]}
    assert scene == {"name": "Room", "object_count": 4, "materials_count": 1}
    assert told["endpoint"]["first"] == 10


def test_an_endpoint_finds_by_name_with_beginnings_first(told):
    everything, table, k, nothing = told["endpoint"]["found"]
    assert [(item["kind"], item["name"], item["detail"]) for item in everything["items"]] == [
        ("object", "Table", "Mesh"),
        ("object", "Knob of the table", "Mesh"),
        ("object", "Camera", "Camera"),
        ("object", "Lamp", "Light"),
        ("material", "Oak", "Material, 1 users"),
        ("collection", "Kit", "Collection"),
    ]
    assert [item["name"] for item in table["items"]] == ["Table", "Knob of the table"]
    assert [item["name"] for item in k["items"]] == ["Knob of the table", "Kit", "Oak"]
    assert nothing == {"items": [], "total": 0}
    least = told["endpoint"]["least"]
    assert (len(least["items"]), least["total"]) == (1, 6)
    assert told["endpoint"]["many"] == [100, 246, 30]


def test_an_endpoint_looks_through_the_camera_and_changes_no_setting(told):
    assert "no active camera" in told["endpoint"]["no camera"]["error"]
    looks, kept = told["endpoint"]["looks"]
    assert [look[:4] for look in looks] == [
        [800, 12, 800, 12], [16, 4, 16, 4], [2048, 32, 2048, 32]
    ]  # fmt: skip
    about = {"success": True, "file": "", "scene": "Room", "scene_count": 1}
    assert [look[4:] for look in looks] == [[True, "camera_render", about]] * 3
    assert kept == [128, 25, "/mine", "BLENDER_WORKBENCH", True]


def test_an_endpoint_exports_all_or_what_is_chosen_with_its_children(told):
    exports = told["endpoint"]["exports"]
    assert exports["format"]["error"] == "this endpoint exports glb, not 'FBX'"
    assert exports["absent"]["error"] == "Objects not found in Blender: Sofa, Bed"
    assert "Nothing is selected" in exports["unselected"]["error"]
    chosen = ["Knob of the table", "Table"]
    for name in ("named", "selected"):
        assert exports[name] == {"selection_only": True, "exported": chosen, "nodes": chosen}
    last = ["e97", "e98", "e99"]
    assert exports["all"] == {"selection_only": False, "exported": last, "nodes": last}


def test_a_reference_scene_declares_its_cases(told):
    (joint,) = told["cases"]["declared"].pop("joints")
    assert (joint["object"], joint["parent"], joint["text"]) == ("Knob", "Second", "hinge")
    assert told["cases"]["declared"] == {
        "environment": "indoor", "theme": None, "split": None,
        "views": ["Odd", "Also", "Top", "Side"],  # by number, then by name
        "tiers": ["easy", "medium", "hard"],
        "unscored": ["Base", "Knob", "Later"],
    }  # fmt: skip


def test_a_case_hides_what_later_tiers_add(told):
    both = {"camera": ["Top", [None]], "size": [7, 5, 100], "scenes": 1}
    assert told["cases"]["medium"] == {
        **both, "hidden": ["Deep", "Knob"], "files": ["scene.blend", "scene.glb"]
    }  # fmt: skip
    assert told["cases"]["None"] == {**both, "hidden": [], "files": ["scene.blend"]}


def test_what_is_wrong_with_tiers_is_named(told):
    wrong = told["cases"]["wrong"]
    assert wrong.pop("none") == [None]
    assert wrong.pop("no view")[0] == "no_camera"
    assert {code for code, _ in wrong.values()} == {"tiers_not_nested"}
    assert {name: found for name, (_, found) in wrong.items()} == {
        "no medium": "medium has the objects of easy and no other",
        "no hard": "hard has the objects of medium and no other",
        "unknown": "'A' is of tier 'huge'",
        "number": "'A' is of tier '1'",
        "earlier than its parent": "'A' is of tier easy, and 'C', which holds it, of hard",
    }


def test_cycles_depth_is_exact_where_a_picture_would_be_out_of_focus(told):
    depth, met = told["depth"]
    assert depth == [["3.0", "4.0", "4.0", "inf"]] * 4
    assert met == [["Card", "Wall", "Wall"]] * 4
