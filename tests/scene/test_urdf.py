"""URDF files beside a scene: trees of joints, and XML that is out to do harm."""

from __future__ import annotations

import math

import pytest

from legoworld.scene.urdf import LARGEST_BYTES, UrdfInvalidError, parse_urdf

CUPBOARD = b"""<?xml version="1.0"?>
<robot name="cupboard" xmlns:xacro="http://ros.org/wiki/xacro">
  <link name="body"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
  <link name="shelf"/> <link name="door"/> <link name="knob"/>
  <joint name="fix" type="fixed">
    <parent link="body"/><child link="shelf"/>
    <origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>
  </joint>
  <joint name="hinge" type="revolute">
    <parent link="shelf"/><child link="door"/><origin xyz="1 0 0"/>
    <axis xyz="0 0 2"/><limit lower="-0.5" upper="1.5" effort="1" velocity="1"/>
  </joint>
  <joint name="spin" type="continuous">
    <parent link="door"/><child link="knob"/><origin rpy="1.5707963267948966 0 0"/>
  </joint>
</robot>"""


def test_a_tree_of_joints():
    robot = parse_urdf(CUPBOARD)
    assert robot.root == "body"
    hinge, knob = robot.joints
    assert (hinge.name, hinge.type, hinge.child) == ("hinge", "revolute", "door")
    assert (hinge.axis, hinge.lower, hinge.upper) == ((0.0, 0.0, 2.0), -0.5, 1.5)
    # The shelf is turned by a quarter about z: its x is the body's y.
    place = [row[3] for row in hinge.root_from_joint]
    assert place == pytest.approx([1.0, 3.0, 3.0])
    assert (knob.axis, knob.lower, knob.upper) == ((1.0, 0.0, 0.0), None, None)
    # A roll of a quarter: the knob's z is the door's -y, which is the body's x.
    assert [row[2] for row in knob.root_from_joint] == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)


def test_roll_pitch_and_yaw_are_about_fixed_axes():
    data = CUPBOARD.replace(b'rpy="0 0 1.5707963267948966"', b'rpy="0.3 0.4 0.5"')
    (hinge, _) = parse_urdf(data).joints
    cos, sin = math.cos, math.sin
    along_x = [cos(0.5) * cos(0.4), sin(0.5) * cos(0.4), -sin(0.4)]  # Rz Ry Rx (1, 0, 0)
    place = [row[3] for row in hinge.root_from_joint]
    assert place == pytest.approx([1 + along_x[0], 2 + along_x[1], 3 + along_x[2]])


LAUGHS = b"""<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">
<!ENTITY c "&b;&b;&b;&b;">]><robot name="&c;"><link name="x"/></robot>"""
OUTSIDE = b"""<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]>
<robot><link name="&x;"/></robot>"""


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no element found"),
        (b"<robot", "unclosed token"),
        (b"\xff\xfe\x00", "not well-formed|unclosed|no element"),
        (b"<sdf/>", "<sdf> where <robot> begins"),
        (b"<robot/>", "0 links"),
        (LAUGHS, "a document type"),
        (OUTSIDE, "a document type"),
        (b"<robot>&lol;</robot>", "undefined entity"),
        (b"<robot>" + b"<a>" * 40 + b"</a>" * 40 + b"</robot>", "levels"),
        (b"<robot>" + b"<a/>" * 100_001 + b"</robot>", "elements"),
        (b" " * (LARGEST_BYTES + 1), "bytes"),
        (CUPBOARD.replace(b'"1 0 0"', b'"1 0"'), "three numbers"),
        (CUPBOARD.replace(b'"1 0 0"', b'"1 0 nan"'), "'nan' as a number"),
        (CUPBOARD.replace(b'"1 0 0"', b'"1 0 1e999"'), "'1e999' as a number"),
        (CUPBOARD.replace(b'"0 0 2"', b'"0 0 0"'), "axis of length 0"),
        (CUPBOARD.replace(b'upper="1.5"', b'upper="wide"'), "'wide' as a number"),
        (CUPBOARD.replace(b'"revolute"', b'"floating"'), "type 'floating'"),
        (CUPBOARD.replace(b'child link="knob"', b'child link="door"'), "moved by two joints"),
        (CUPBOARD.replace(b'child link="knob"', b'child link="hand"'), "without two links"),
        (CUPBOARD.replace(b'child link="knob"', b'child link=""'), "without link"),
        (CUPBOARD.replace(b'<link name="knob"/>', b'<link name="knob"/><link name="2"/>'),
         "2 links that no joint moves"),
        (CUPBOARD.replace(b'parent link="shelf"', b'parent link="knob"'), "in a ring"),
    ],
)  # fmt: skip
def test_what_is_no_tree_of_joints_is_refused(data, words):
    with pytest.raises(UrdfInvalidError, match=words) as caught:
        parse_urdf(data)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500
