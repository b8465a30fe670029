"""Poses, and the joints of a scene as a readout finds them and a bench asks for them."""

from __future__ import annotations

from typing import Final, Literal

from legoworld.records.base import Record
from legoworld.records.track import Motion, Vector

JointType = Literal["revolute", "continuous", "prismatic"]
JOINT_TYPES: Final[tuple[JointType, ...]] = ("revolute", "continuous", "prismatic")
#: OpenCV camera axes to Blender's world, rotation of unit scale.
Pose = Motion


class SceneJoint(Record, frozen=True, kw_only=True):
    """One joint of a scene, in the camera frame: x right, y down, z forward, metres.

    part: the object that moves, with all its descendants; source: `property`, or the URDF file's
    name; axis_cam: of unit length; origin_cam_m: a point of the axis; lower, upper: limits as
    stated (radians or metres), null where none are; box_cam_m: smallest and largest corner of the
    part's geometry, null where it has none.
    """

    part: str
    source: str
    type: JointType
    axis_cam: Vector
    origin_cam_m: Vector
    lower: float | None
    upper: float | None
    box_cam_m: tuple[Vector, Vector] | None
