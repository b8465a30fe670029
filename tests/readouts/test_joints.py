"""Joints of a scene in its camera's frame: from properties and from URDF files, without Blender."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from readouts.quads import SQUARE, at, quads

from legoworld.readouts.joints import (
    JointInvalidError,
    parsed_property,
    part_surfaces,
    scene_joints,
)
from legoworld.scene.folder import SceneFolder

HERE = [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3]  # rows of an object at (1, 2, 3), turned by nothing
#: A quarter turn about z, twice as large, at the origin: its x is the world's y.
TURNED = [0, -2, 0, 0, 2, 0, 0, 0, 0, 0, 2, 0]


def cupboard(unit_scale=1.0):
    """Body > Door > Knob, squares of side 2 in front of the camera at z = 10."""
    snapshot = quads(
        ("Body", SQUARE, at(0, 0, 0)),
        ("Door", SQUARE, at(2, 0, 1)),
        ("Knob", SQUARE * 0.5, at(2, 3, 2)),
        unit_scale=unit_scale,
    )
    body, door, knob = snapshot.objects
    return replace(snapshot, objects=(body, replace(door, parent=0), replace(knob, parent=1)))


def fact(name, text, rows=HERE):
    return {"object": name, "text": text, "world_from_object": rows}


def joints_of(folder, *facts, snapshot=None):
    scene = SceneFolder(path=folder, name="scene")
    return scene_joints(scene, snapshot or cupboard(), facts)


def test_a_type_alone_is_about_the_object_s_own_z_through_its_origin(tmp_path):
    (joint,), warnings = joints_of(tmp_path, fact("Door", " revolute "))
    assert warnings == []
    assert (joint.part, joint.source, joint.type) == ("Door", "property", "revolute")
    assert joint.axis_cam == (0.0, 0.0, -1.0)
    assert joint.origin_cam_m == (1.0, -2.0, 7.0)
    assert (joint.lower, joint.upper) == (None, None)
    # The door's and the knob's corners: x 1 to 3, y -1 to 3.5, z 1 and 2 in the world.
    assert joint.box_cam_m == ((1.0, -3.5, 8.0), (3.0, 1.0, 9.0))


def test_metres_are_not_scene_units(tmp_path):
    (joint,), _ = joints_of(tmp_path, fact("Door", "prismatic"), snapshot=cupboard(0.1))
    assert joint.origin_cam_m == pytest.approx((0.1, -0.2, 0.7))
    assert joint.box_cam_m is not None
    assert np.ravel(joint.box_cam_m) == pytest.approx([0.1, -0.35, 0.8, 0.3, 0.1, 0.9])
    assert joint.axis_cam == (0.0, 0.0, -1.0)


def test_axis_and_origin_are_the_object_s_and_turn_with_it(tmp_path):
    text = json.dumps(
        {"type": "continuous", "axis": [3, 0, 0], "origin": [1, 0, 0], "lower": -1, "upper": 2.5}
    )
    (joint,), _ = joints_of(tmp_path, fact("Door", text, TURNED))
    assert joint.axis_cam == (0.0, -1.0, 0.0)
    assert joint.origin_cam_m == (0.0, -2.0, 10.0)
    assert (joint.lower, joint.upper) == (-1.0, 2.5)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("hinge", "type 'hinge'"),
        ("", "type ''"),
        ("{", "no JSON"),
        ("{}", "type 'None'"),
        ("[" * 100_000, "type"),
        ('{"a":' * 100_000, "no JSON"),
        ('{"type": "revolute", "axis": [0, 0, 0]}', "an axis of length 0"),
        ('{"type": "revolute", "axis": [0, 1]}', "axis [0, 1]"),
        ('{"type": "revolute", "axis": [0, 1, true]}', "axis [0, 1, True]"),
        ('{"type": "revolute", "axis": "xyz"}', "axis xyz"),
        ('{"type": "revolute", "origin": [0, 0, NaN]}', "origin [0, 0, nan]"),
        ('{"type": "revolute", "origin": [0, 0, 1e10]}', "origin [0, 0, 10000000000.0]"),
        ('{"type": "revolute", "lower": "0"}', "limit 0"),
        ('{"type": "revolute", "upper": Infinity}', "limit inf"),
    ],
)
def test_a_property_that_cannot_be_used(tmp_path, text, found):
    with pytest.raises(JointInvalidError) as raised:
        parsed_property("Door", text)
    assert found in str(raised.value)
    joints, (warning,) = joints_of(tmp_path, fact("Door", text), fact("Knob", "revolute"))
    assert [joint.part for joint in joints] == ["Knob"]
    assert "`joint` of 'Door'" in warning
    assert len(warning) <= 300


def test_a_billion_is_a_number_and_more_is_none():
    text = '{"type": "revolute", "origin": [1e9, -1e9, 0], "lower": 1e9}'
    assert parsed_property("Door", text)["origin"] == (1e9, -1e9, 0.0)


def test_an_object_without_a_finite_place_has_no_joint(tmp_path):
    joints, (warning,) = joints_of(tmp_path, fact("Door", "revolute", None))
    assert joints == ()
    assert "finite place" in warning


def test_a_part_is_an_object_with_its_descendants():
    assert part_surfaces(cupboard(), "Body").tolist() == [0, 1, 2]
    assert part_surfaces(cupboard(), "Door").tolist() == [1, 2]
    assert part_surfaces(cupboard(), "Knob").tolist() == [2]
    assert part_surfaces(cupboard(), "Shelf").tolist() == []


def test_what_a_part_instances_is_the_part_s():
    # The second occurrence generates the third, and that one the first.
    snapshot = replace(cupboard(), occurrence_instancer=np.array([2, -1, 1], np.int32))
    assert part_surfaces(snapshot, "Door").tolist() == [0, 1, 2]
    assert part_surfaces(snapshot, "Knob").tolist() == []


def test_of_objects_of_one_name_the_first_is_meant():
    snapshot = cupboard()
    body, door, knob = snapshot.objects
    twice = replace(snapshot, objects=(body, door, replace(knob, name="Door", parent=-1)))
    assert part_surfaces(twice, "Door").tolist() == [1]


def test_joints_are_in_order_of_their_parts_and_512_at_most(tmp_path):
    many = [fact(f"Part {i:04}", "revolute") for i in reversed(range(600))]
    joints, _ = joints_of(tmp_path, *many)
    # The first 512 that were stated, in order of names.
    assert [j.part for j in joints] == [f"Part {i:04}" for i in range(88, 600)]
    assert joints[0].box_cam_m is None


URDF = """<robot name="cupboard"><link name="body"/><link name="door"/><link name="Lid"/>
<joint name="hinge" type="revolute"><parent link="body"/><child link="door"/>
<origin xyz="1 0 0"/><axis xyz="0 1 0"/><limit lower="0" upper="1.5"/></joint>
<joint name="slide" type="prismatic"><parent link="body"/><child link="Lid"/>
<axis xyz="0 0 1"/></joint></robot>"""


def test_a_urdf_file_s_links_are_objects_of_the_same_name(tmp_path):
    (tmp_path / "a.urdf").write_text(URDF)
    snapshot = replace(
        cupboard(unit_scale=0.5),
        world_from_mesh=np.array([at(0, 4, 0, np.eye(3) * 3), at(2, 0, 1), at(2, 3, 2)]),
    )
    joints, warnings = joints_of(tmp_path, fact("Door", "prismatic"), snapshot=snapshot)
    assert warnings == []
    door, lid = joints
    # The file's joint goes before the property's; its metres are two units each, and the body's
    # scale does not stretch them: x = 2 units beside the body at y = 4.
    assert (door.part, door.source, door.type) == ("Door", "a.urdf", "revolute")
    assert door.axis_cam == (0.0, -1.0, 0.0)
    assert door.origin_cam_m == pytest.approx((1.0, -2.0, 5.0))
    assert (door.lower, door.upper) == (0.0, 1.5)
    assert door.box_cam_m is not None
    # A link that is no object keeps its name and has no geometry.
    assert (lid.part, lid.type, lid.box_cam_m) == ("Lid", "prismatic", None)
    assert lid.origin_cam_m == pytest.approx((0.0, -2.0, 5.0))


def test_a_root_that_is_no_object_or_has_no_surface_stands_at_the_world_s_origin(tmp_path):
    (tmp_path / "a.urdf").write_text(URDF.replace('"body"', '"frame"'))
    (door, _), _ = joints_of(tmp_path)
    assert door.origin_cam_m == pytest.approx((1.0, 0.0, 10.0))
    (tmp_path / "a.urdf").write_text(URDF)
    # The body is only instanced: where it stands is another's.
    made = replace(cupboard(), occurrence_instancer=np.array([1, -1, -1], np.int32))
    moved = replace(made, world_from_mesh=np.array([at(5, 5, 5), at(2, 0, 1), at(2, 3, 2)]))
    (door, _), _ = joints_of(tmp_path, snapshot=moved)
    assert door.origin_cam_m == pytest.approx((1.0, 0.0, 10.0))


def test_a_urdf_file_that_cannot_be_used_is_told_and_the_others_are_read(tmp_path):
    (tmp_path / "a.urdf").write_text("<robot")
    (tmp_path / "b.urdf").write_text(URDF)
    joints, (warning,) = joints_of(tmp_path)
    assert [j.source for j in joints] == ["b.urdf", "b.urdf"]
    assert warning.startswith("a.urdf: ")
    assert "\n" not in warning
