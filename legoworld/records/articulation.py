"""Joints of a scene and the counts of the articulation pilot (docs/protocols/bench.md)."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta

from legoworld.records.base import Record

JointType = Literal["revolute", "continuous", "prismatic"]
JOINT_TYPES: Final[tuple[JointType, ...]] = ("revolute", "continuous", "prismatic")
Vector = tuple[float, float, float]
Count = Annotated[int, Meta(ge=0)]
#: What became of a reference joint: the counts C, W, P, O, J, and ignored, which no count has.
Outcome = Literal[
    "correct", "wrong", "part_missing", "object_missing", "joint_missing", "ignored"
]  # fmt: skip


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


class ReferenceJoint(SceneJoint, frozen=True, kw_only=True):
    """A joint of a reference. object_id: the scored object its part belongs to, null for none."""

    object_id: int | None


class JointRow(Record, frozen=True, kw_only=True):
    """What became of one reference joint.

    object: name of the scored object, null where the joint is of none and ignored; matched: the
    submission's part, null where no joint corresponds; box_iou, axis_deg, axis_apart_m: of those
    two, null without a match (axis_apart_m also where either slides).
    """

    part: str
    object: str | None
    type: JointType
    outcome: Outcome
    matched: str | None
    box_iou: float | None
    axis_deg: float | None
    axis_apart_m: float | None


class JointCounts(Record, frozen=True, kw_only=True):
    """C correct, W wrong, P part missing, O object missing, J joint missing, E extra.

    score: 2C / (2C + O + P + J + 2W + E); null where there is nothing to count.
    """

    C: Count
    W: Count
    P: Count
    O: Count  # noqa: E741  the formula's letter
    J: Count
    E: Count
    score: float | None


class Articulation(JointCounts, frozen=True, kw_only=True):
    """The pilot's part of a case. extra: parts of the submission's joints that match none."""

    joints: tuple[JointRow, ...]
    extra: tuple[str, ...]


class ArticulationSummary(JointCounts, frozen=True, kw_only=True):
    """Counts over all attempted cases whose reference has scored joints.

    score: of the summed counts; mean_score: the unweighted mean of the cases' scores; card_*: the
    provisional card, readouts/pilots/articulation.toml.
    """

    cases: Count
    mean_score: float | None
    provisional: Literal[True]
    card_version: str
    card_sha256: str
