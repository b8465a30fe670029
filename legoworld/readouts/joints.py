"""A scene's joints in its camera's frame: from `joint` properties and URDF files beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Final, TypeGuard, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, one_line
from legoworld.files import Json, as_unicode
from legoworld.records.joints import JOINT_TYPES, JointType, SceneJoint
from legoworld.records.track import Vector
from legoworld.scene.affine import cam_from_mesh, transform_points, unit
from legoworld.scene.folder import SceneFolder
from legoworld.scene.requests import JointFact
from legoworld.scene.side_files import bytes_beside
from legoworld.scene.snapshot import Snapshot
from legoworld.scene.urdf import LARGEST_BYTES, MOST_FILES, UrdfRobot, parse_urdf
from legoworld.tracks.vocabulary import normal_name

_PROPERTY: Final = "property"
#: Of a property that names a type alone: the object's own z axis through its origin.
_AXIS: Final = (0.0, 0.0, 1.0)
_ORIGIN: Final = (0.0, 0.0, 0.0)
#: More joints than this of one scene are not read.
_MOST_JOINTS: Final = 512
#: Metres or radians beyond this are no joint's.
_LARGEST: Final = 1e9
F64 = NDArray[np.float64]


class JointInvalidError(LegoWorldError):
    """A `joint` property cannot be used; that joint is left out, with a warning."""

    code = "invalid_joint"


def scene_joints(
    folder: SceneFolder, snapshot: Snapshot, facts: Sequence[JointFact]
) -> tuple[tuple[SceneJoint, ...], list[str]]:
    """The joints of a scene by their part's name, and what was left out, in words.

    facts: of `joint` properties, as scene/blender/joints.py has them. A part that a URDF file moves
    has that file's joint, whatever its property says. Nothing here raises for a scene's content.
    """
    made, warnings = _Scene(snapshot), []
    joints: dict[str, SceneJoint] = {}
    for fact in facts[:_MOST_JOINTS]:
        try:
            joints[fact["object"]] = made.read_property(fact)
        except LegoWorldError as error:
            warnings.append(one_line(str(error), 300))
    for name in folder.urdf_files()[:MOST_FILES]:
        try:
            data = bytes_beside(folder.path, name, LARGEST_BYTES)
            robot = parse_urdf(data or b"")
        except LegoWorldError as error:
            warnings.append(one_line(f"{name}: {error}", 300))
            continue
        for joint in made.read_robot(name, robot)[:_MOST_JOINTS]:
            joints[joint.part] = joint
    ordered = sorted(joints.values(), key=lambda joint: (joint.part, joint.source))
    return tuple(ordered[:_MOST_JOINTS]), warnings


def part_surfaces(snapshot: Snapshot, part: str) -> NDArray[np.int64]:
    """(n,) surfaces of an object and its descendants, what they instance included, ascending."""
    return _Scene(snapshot).descendant_surfaces(part)


def parsed_property(name: str, text: str) -> dict[str, Any]:
    """type, axis, origin, lower and upper of a `joint` property. JointInvalidError.

    text: a joint's type alone, or a JSON object of these keys.
    """
    values: Any = {"type": text.strip()}
    if text.lstrip().startswith("{"):
        try:
            values = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise _invalid(name, f"no JSON: {error}") from error
    kind = values.get("type")
    if kind not in JOINT_TYPES:
        raise _invalid(name, f"type {str(kind)[:40]!r}")
    axis = _vector(name, values.get("axis", _AXIS), "axis")
    if not any(axis):
        raise _invalid(name, "an axis of length 0")
    return {
        "type": kind,
        "axis": axis,
        "origin": _vector(name, values.get("origin", _ORIGIN), "origin"),
        "lower": _limit(name, values.get("lower")),
        "upper": _limit(name, values.get("upper")),
    }


def _invalid(name: str, found: str) -> JointInvalidError:
    return JointInvalidError(
        f"the property `joint` of {as_unicode(name)!r} cannot be used",
        found=found,
        expected='revolute, continuous or prismatic, or {"type", "axis", "origin", "lower", '
        '"upper"} with three finite numbers for axis and origin',
        next_step="correct the property",
    )


def _vector(name: str, value: Json, what: str) -> Vector:
    if isinstance(value, (list, tuple)) and len(value) == 3 and all(map(_is_number, value)):
        x, y, z = (float(cast("float", v)) for v in value)
        return x, y, z
    raise _invalid(name, f"{what} {str(value)[:60]}")


def _limit(name: str, value: Json) -> float | None:
    if value is None or _is_number(value):
        return None if value is None else float(value)
    raise _invalid(name, f"limit {str(value)[:60]}")


def _is_number(value: Json) -> TypeGuard[float]:
    return (
        isinstance(value, (int, float))
        and not isinstance(value, bool)
        and abs(value) <= _LARGEST
        and math.isfinite(value)
    )


class _Scene:
    """The lookups that every joint of one snapshot needs."""

    def __init__(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot
        self._index = {o.name: i for i, o in reversed(list(enumerate(snapshot.objects)))}
        self._by_normal_name: dict[str, str] = {}
        for name in self._index:
            self._by_normal_name.setdefault(normal_name(name), name)
        self._children: dict[int, list[int]] = {}
        for i, thing in enumerate(snapshot.objects):
            self._children.setdefault(thing.parent, []).append(i)
        self._metres = snapshot.render.unit_scale
        self._holder: NDArray[np.int64] | None = None

    def read_property(self, fact: JointFact) -> SceneJoint:
        """The joint of one fact. JointInvalidError."""
        name = fact["object"]
        values = parsed_property(name, fact["text"])
        if fact["world_from_object"] is None:
            raise _invalid(name, "an object that does not stand at a finite place")
        rows = np.array(fact["world_from_object"], np.float64).reshape(3, 4)
        return self._joint(
            name, _PROPERTY, rows,
            values["type"], values["axis"], values["origin"], values["lower"], values["upper"],
        )  # fmt: skip

    def read_robot(self, source: str, robot: UrdfRobot) -> list[SceneJoint]:
        """The joints of a URDF tree, whose links are objects of the same name.

        A root link that is an object stands where the object does, any other one at the world's
        origin; a link that is no object keeps its own name and has no geometry.
        """
        root = self._root(robot.root)
        joints = []
        for joint in robot.joints:
            part = self._object(joint.child) or joint.child
            link = np.array(joint.root_from_joint, np.float64)
            rows = np.empty((3, 4))
            rows[:, :3] = transform_points(root, link[:, :3].T, directions=True).T
            rows[:, 3] = transform_points(root, link[:, 3] / self._metres)
            joints.append(
                self._joint(
                    part, source, rows, joint.type, joint.axis, _ORIGIN, joint.lower, joint.upper
                )
            )
        return joints

    def _object(self, link: str) -> str | None:
        return link if link in self._index else self._by_normal_name.get(normal_name(link))

    def _root(self, link: str) -> F64:
        """(3, 4) world_from_root in scene units, of unit scale."""
        rows = np.eye(4)[:3].copy()
        name = self._object(link)
        if name is None:
            return rows
        own = self._own_placement(name)
        if own is None:
            return rows
        rows[:, :3] = unit(own[:, :3].T).T
        rows[:, 3] = own[:, 3]
        return rows

    def _own_placement(self, name: str) -> F64 | None:
        """world_from_mesh of an object's own first surface; None where it has none."""
        snapshot = self._snapshot
        at_scene = snapshot.occurrence_instancer[snapshot.surface_occurrence] < 0
        own = snapshot.occurrence_object[snapshot.surface_occurrence] == self._index[name]
        placements = np.flatnonzero(own & at_scene)
        return snapshot.world_from_mesh[placements[0]] if len(placements) else None

    def _joint(
        self,
        part: str,
        source: str,
        world_from_joint: F64,
        kind: str,
        axis: Vector,
        origin: Vector,
        lower: float | None,
        upper: float | None,
    ) -> SceneJoint:
        camera = self._snapshot.camera
        cam_from_joint = cam_from_mesh(camera, world_from_joint[None])[0]
        along = transform_points(cam_from_joint, np.array(axis), directions=True)
        at = transform_points(cam_from_joint, np.array(origin)) * self._metres
        box = self._box(part)
        return SceneJoint(
            part=as_unicode(part),
            source=as_unicode(source),
            type=cast("JointType", kind),
            axis_cam=_triple(unit(along)),
            origin_cam_m=_triple(at),
            lower=lower,
            upper=upper,
            box_cam_m=None if box is None else (_triple(box[0]), _triple(box[1])),
        )

    def _box(self, part: str) -> F64 | None:
        """(2, 3) corners, camera frame, metres, of a part's vertices; None without any."""
        snapshot = self._snapshot
        surfaces = self.descendant_surfaces(part)
        placed = cam_from_mesh(snapshot.camera, snapshot.world_from_mesh[surfaces])
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for matrix, mesh in zip(placed, snapshot.surface_mesh[surfaces].tolist(), strict=True):
            begin, end = snapshot.vertex_start[mesh], snapshot.vertex_start[mesh + 1]
            points = transform_points(matrix, snapshot.vertices[begin:end].astype(np.float64))
            if len(points):
                low = np.minimum(low, points.min(axis=0))
                high = np.maximum(high, points.max(axis=0))
        return np.stack([low, high]) * self._metres if (low <= high).all() else None

    def descendant_surfaces(self, part: str) -> NDArray[np.int64]:
        """Surfaces of an object and its descendants, what they instance included, ascending."""
        snapshot = self._snapshot
        if part not in self._index:
            return np.empty(0, np.int64)
        inside, todo = np.zeros(len(snapshot.objects), bool), [self._index[part]]
        while todo:
            at = todo.pop()
            inside[at] = True
            todo += [child for child in self._children.get(at, ()) if not inside[child]]
        return np.flatnonzero(inside[self._holders()[snapshot.surface_occurrence]])

    def _holders(self) -> NDArray[np.int64]:
        """(K,) object of the scene itself that each occurrence is, or is generated by."""
        if self._holder is None:
            snapshot = self._snapshot
            at = np.arange(len(snapshot.occurrence_object))
            while True:
                above = snapshot.occurrence_instancer[at]
                if (above < 0).all():
                    break
                at = np.where(above >= 0, above, at)
            self._holder = snapshot.occurrence_object[at].astype(np.int64)
        return self._holder


def _triple(values: F64) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
