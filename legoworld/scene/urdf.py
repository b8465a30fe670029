"""URDF files beside a scene: untrusted XML to a tree of links and joints.

http://wiki.ros.org/urdf/XML. Read are robot, link (its name), joint with origin, parent, child,
axis and limit; everything else is skipped. No document type is accepted, so there is no entity to
expand and nothing outside of the file is ever opened.
"""

from __future__ import annotations

import math
import xml.parsers.expat
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from legoworld.errors import SceneInvalidError
from legoworld.records.joints import JOINT_TYPES, JointType
from legoworld.records.track import Vector

Rows = tuple[tuple[float, float, float, float], ...]

LARGEST_BYTES: Final = 4 << 20
MOST_FILES: Final = 64
_MOST_ELEMENTS: Final = 100_000
_DEEPEST: Final = 32
#: Joints of these types are part of the tree but do not articulate.
_FIXED: Final = "fixed"
_IDENTITY: Final[Rows] = (
    (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)
)  # fmt: skip


class UrdfInvalidError(SceneInvalidError):
    """A URDF file cannot be used; its joints are left out."""

    code = "invalid_urdf"


@dataclass(frozen=True, kw_only=True)
class UrdfJoint:
    """A joint that moves. root_from_joint: (3, 4) rows at the zero configuration, metres.

    axis: as stated, in the joint's frame; child: name of the link that moves.
    """

    name: str
    type: JointType
    child: str
    root_from_joint: Rows
    axis: Vector
    lower: float | None
    upper: float | None


@dataclass(frozen=True, kw_only=True)
class UrdfRobot:
    """A tree of links. root: the link that no joint moves; joints: in the file's order."""

    root: str
    joints: tuple[UrdfJoint, ...]


@dataclass(kw_only=True)
class _Joint:
    """A joint while its element is read."""

    name: str
    type: str
    parent: str = ""
    child: str = ""
    parent_from_joint: Rows = _IDENTITY
    axis: Vector = (1.0, 0.0, 0.0)
    lower: float | None = None
    upper: float | None = None


def parse_urdf(data: bytes) -> UrdfRobot:
    """A file's content as a tree. UrdfInvalidError for anything that is not one."""
    if len(data) > LARGEST_BYTES:
        raise _invalid(f"more than {LARGEST_BYTES:,} bytes")
    reader = _Reader()
    parser = xml.parsers.expat.ParserCreate()
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.StartDoctypeDeclHandler = _refuse_doctype
    try:
        parser.Parse(data, True)
    except (xml.parsers.expat.ExpatError, ValueError) as error:
        raise _invalid(str(error)) from error
    return _robot(reader)


def _invalid(found: str) -> UrdfInvalidError:
    return UrdfInvalidError(
        "a URDF file cannot be used",
        found=found[:200],
        expected="a robot whose joints make one tree of its links",
        next_step="correct the file, or delete it to use the scene's `joint` properties alone",
    )


def _refuse_doctype(*_declared: object) -> None:
    raise _invalid("a document type; entities are never expanded")


class _Reader:
    """Collects links and joints while expat walks through the file."""

    def __init__(self) -> None:
        self.links: list[str] = []
        self.joints: list[_Joint] = []
        self._open: list[str] = []
        self._elements = 0

    def start(self, tag: str, attributes: Mapping[str, str]) -> None:
        self._elements += 1
        if self._elements > _MOST_ELEMENTS or len(self._open) >= _DEEPEST:
            raise _invalid(f"more than {_MOST_ELEMENTS:,} elements or {_DEEPEST} levels")
        if not self._open and tag != "robot":
            raise _invalid(f"<{tag}> where <robot> begins")
        self._open.append(tag)
        if self._open == ["robot", "link"]:
            self.links.append(_require_attribute(attributes, "name", "a link"))
        elif self._open == ["robot", "joint"]:
            name = _require_attribute(attributes, "name", "a joint")
            self.joints.append(_Joint(name=name, type=attributes.get("type", "")))
        elif self._open[:2] == ["robot", "joint"] and len(self._open) == 3:
            self._read_joint_part(self.joints[-1], tag, attributes)

    def end(self, _tag: str) -> None:
        self._open.pop()

    def _read_joint_part(self, joint: _Joint, tag: str, attributes: Mapping[str, str]) -> None:
        what = f"{tag} of joint {joint.name!r}"
        if tag in ("parent", "child"):
            setattr(joint, tag, _require_attribute(attributes, "link", what))
        elif tag == "origin":
            xyz = _vector(attributes.get("xyz", "0 0 0"), what)
            rpy = _vector(attributes.get("rpy", "0 0 0"), what)
            joint.parent_from_joint = _pose(xyz, rpy)
        elif tag == "axis":
            joint.axis = _vector(attributes.get("xyz", "1 0 0"), what)
        elif tag == "limit":
            joint.lower = _number(attributes["lower"], what) if "lower" in attributes else None
            joint.upper = _number(attributes["upper"], what) if "upper" in attributes else None


def _require_attribute(attributes: Mapping[str, str], key: str, what: str) -> str:
    if not attributes.get(key):
        raise _invalid(f"{what} without {key}")
    return attributes[key]


def _number(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _invalid(f"{text[:40]!r} as a number in {what}")
    return value


def _vector(text: str, what: str) -> Vector:
    parts = text.split()
    if len(parts) != 3:
        raise _invalid(f"{text[:40]!r} as three numbers in {what}")
    x, y, z = (_number(part, what) for part in parts)
    return x, y, z


def _pose(xyz: Vector, rpy: Vector) -> Rows:
    """(3, 4) rows: roll, pitch and yaw about the fixed axes x, y, z in this order."""
    cr, cp, cy = map(math.cos, rpy)
    sr, sp, sy = map(math.sin, rpy)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, xyz[0]),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, xyz[1]),
        (-sp, cp * sr, cp * cr, xyz[2]),
    )


def _after(a: Rows, b: Rows) -> Rows:
    """The transform b, then a."""
    rows = []
    for row in a:
        turned = [sum(row[k] * b[k][c] for k in range(3)) for c in range(4)]
        rows.append((turned[0], turned[1], turned[2], turned[3] + row[3]))
    return tuple(rows)


def _robot(reader: _Reader) -> UrdfRobot:
    moved: dict[str, _Joint] = {}
    links = dict.fromkeys(reader.links)
    for joint in reader.joints:
        if joint.parent not in links or joint.child not in links:
            raise _invalid(f"joint {joint.name!r} without two links of the file")
        if joint.child in moved:
            raise _invalid(f"link {joint.child!r} moved by two joints")
        moved[joint.child] = joint
    roots = [name for name in links if name not in moved]
    if len(roots) != 1:
        raise _invalid(f"{len(roots)} links that no joint moves")
    frames = _frames(roots[0], moved)
    robots = [
        _make_moving_joint(joint, frames[joint.child])
        for joint in reader.joints
        if joint.type != _FIXED
    ]
    return UrdfRobot(root=roots[0], joints=tuple(robots))


def _frames(root: str, moved: Mapping[str, _Joint]) -> dict[str, Rows]:
    """root_from_link of every link, parents first: a link that is never reached is in a ring."""
    below: dict[str, list[_Joint]] = {}
    for joint in moved.values():
        below.setdefault(joint.parent, []).append(joint)
    frames: dict[str, Rows] = {root: _IDENTITY}
    todo = [root]
    while todo:
        parent = todo.pop()
        for joint in below.get(parent, ()):
            frames[joint.child] = _after(frames[parent], joint.parent_from_joint)
            todo.append(joint.child)
    if len(frames) <= len(moved):
        raise _invalid("joints that go round in a ring")
    return frames


def _make_moving_joint(joint: _Joint, frame: Rows) -> UrdfJoint:
    if joint.type not in JOINT_TYPES:
        raise _invalid(f"joint {joint.name!r} of type {joint.type[:40]!r}")
    if not any(joint.axis):
        raise _invalid(f"joint {joint.name!r} with an axis of length 0")
    return UrdfJoint(
        name=joint.name,
        type=joint.type,
        child=joint.child,
        root_from_joint=frame,
        axis=joint.axis,
        lower=joint.lower,
        upper=joint.upper,
    )
