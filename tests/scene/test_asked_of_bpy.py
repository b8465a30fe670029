"""Joints, images, settings and hair, asked of Blender's own Python with no scene file between."""

from __future__ import annotations

from typing import Any

import pytest
from scene.in_bpy import run_in_bpy

pytestmark = pytest.mark.blender


@pytest.fixture(scope="module")
def told() -> Any:
    return run_in_bpy("asked_of_bpy.py")


def test_a_joint_s_frame_is_finite_or_there_is_none(told):
    away, door = told["joints"]
    assert away == {
        "object": "Away", "parent": "Huge", "text": "x" * 2000, "world_from_object": None
    }  # fmt: skip
    assert door == {
        "object": "Door",
        "parent": "Body",
        "text": '{"axis": [0, 0, 1], "lower": 0, "type": "revolute"}',
        "world_from_object": [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3],
    }


def test_what_shows_an_image(told):
    assert told["images"] == {
        "users": {"image 0": ["compositor"], "image 1": ["material"], "image 2": ["camera"]},
        "of objects": {"Painted": ["image 1"]},
        "nodes": 1,  # of a group that is used twice
    }


def test_values_of_settings_keep_their_type(told):
    assert told["settings"]["custom"] == {
        "inner": {"a": "b"}, "of": ["Object", "Body"], "part": "1.0", "row": [1, 2], "text": "1",
        "whole": 1, "yes": True,
    }  # fmt: skip
    assert told["settings"]["plain"] == ["01ff", ["a", "b"], "0.5", 2, "s", None, ["1.0", True]]


def test_a_mesh_s_hash_is_of_what_a_render_uses(told):
    hashes = told["settings"]["meshes"]
    plain = hashes.pop("")
    assert [name for name in hashes if hashes[name] == plain] == ["hidden", "chosen"]
    assert len(set(hashes.values())) == 4


def test_an_image_is_its_pixels_and_how_they_are_read(told):
    assert len(set(told["settings"]["images"].values())) == 4
    # As its file is, painted on, with another file of the same size and time, and with none.
    assert len(set(told["settings"]["files"])) == 4


def test_a_shape_key_is_its_points(told):
    one, same, other = told["settings"]["shapes"]
    assert one == same != other


def test_settings_of_an_add_on_are_no_custom_properties(told):
    assert not told["settings"]["add-on"]


def test_a_link_is_both_its_sockets(told):
    x, y = "X", "Y"
    assert told["settings"]["links"] == [
        [["Separate XYZ", x, "Math", "Value"]],
        [["Separate XYZ", x, "Math", "Value_001"]],
        [["Separate XYZ", y, "Math", "Value"]],
    ]


@pytest.mark.parametrize("kind", ["hair", "curves"])
def test_strands_are_seen_or_held_out(told, kind):
    assert told["hair"][kind] == {
        "there": [0, -1],
        "gone": [-1, -1],
        "holdout": [-1, 0],
        "there in a holdout": [-1, 0],
        "holdout in a holdout": [-1, 0],
        "gone in a holdout": [-1, -1],
        "not drawn": [-1, -1],
        "flat": [-1, -1],
    }


def test_systems_of_an_object_are_two_meshes_at_most(told):
    one = told["hair"]["by subdivisions"][2]
    # Slots 0, 1, 5 and 2 of three materials: gone, there, and the last one's holdout twice.
    assert told["hair"]["several"] == [[0, 1], [one, 2 * one], True]
    assert told["hair"]["no system"] == [[-1, -1], False]
    assert told["hair"]["flat normals"]


def test_quads_of_a_ribbon_are_by_subdivisions_and_sixteen_at_most(told):
    triangles = told["hair"]["by subdivisions"]
    assert [n * 2 / triangles[0] for n in triangles] == [2, 3, 5, 9, 16, 16]


def test_strands_are_drawn_by_their_shape_and_view(told):
    round_, linear = told["hair"]["thick"]
    assert round_ < linear == told["hair"]["straight"]  # linear ones have a ball at each key
    assert told["hair"]["two meshes of one object"][1] == linear
    near, wide = told["hair"]["wide view"]
    assert near > wide


def test_points_are_spheres_of_their_radius_where_they_are(told):
    points = told["hair"]["points"]
    assert points["mesh"] == [1, 1, 0]  # the small one is coarser
    assert points["round"] == [True, True]
    assert not points["holdout"]
    (first, second, third) = points["placed"]
    assert first == [[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7]]
    assert second == [[0, -0.5, 0, 1], [0.5, 0, 0, 8], [0, 0, 0.5, 13]]
    assert [row[3] for row in third] == [5, 6, 15]


def test_points_are_held_out_or_not_there(told):
    assert told["hair"]["points of a holdout"]["holdout"]
    assert told["hair"]["points in a holdout"]["holdout"]
    for name in ("no points", "flat points", "points that are gone"):
        assert told["hair"][name] is None
