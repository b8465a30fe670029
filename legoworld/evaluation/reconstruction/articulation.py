"""The articulation pilot: reference joints that a submission has, has wrong, or lacks, and why.

2C / (2C + O + P + J + 2W + E) is F1 over joints: O + P + J + W of the reference's are not found,
W + E of the submission's are not right. readouts/pilots/articulation.toml, a provisional card, has
what decides each.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from legoworld.cards import read_values
from legoworld.evaluation.reconstruction.points import F64
from legoworld.records.bench_dataset import (
    Articulation,
    JointCounts,
    JointRow,
    Outcome,
    ReferenceJoint,
)
from legoworld.records.joints import JOINT_TYPES, SceneJoint
from legoworld.records.track import Vector
from legoworld.shipped import catalog
from legoworld.tasks.shipped import BENCH

_CARD: Final = "pilots/articulation"
_FIXED: Final[dict[str, Any]] = {
    "pilot.name": "articulation",
    "pilot.task": BENCH,
    "pilot.status": "provisional",
    "joints.types": list(JOINT_TYPES),
    "joints.property": "joint",
    "joints.property_axis": [0.0, 0.0, 1.0],
    "joints.urdf_root": "object_or_world",
    "joints.limits": "recorded",
    "matching.frame": "camera",
    "matching.assignment": "largest_sum",
    "scoring.score": "2C / (2C + O + P + J + 2W + E)",
    "scoring.continuous": "revolute",
    "scoring.not_valid": "object_missing",
}
_LETTER: Final[dict[Outcome, str]] = {
    "correct": "C",
    "wrong": "W",
    "part_missing": "P",
    "object_missing": "O",
    "joint_missing": "J",
}


@dataclass(frozen=True, kw_only=True)
class ArticulationRules:
    """The card's numbers. box_pad, max_axis_apart: shares of the reference part's depth."""

    version: str
    sha256: str
    box_pad: float
    min_box_iou: float
    present_recall: float
    max_axis_deg: float
    max_axis_apart: float


@cache
def articulation_rules() -> ArticulationRules:
    """The shipped card. InstallationError when a fixed value is not the code's."""
    card = read_values(catalog.folder("readouts") / f"{_CARD}.toml", _CARD)
    card.hold_to(_FIXED)
    return ArticulationRules(
        version=card.value("pilot.version"),
        sha256=card.sha256,
        box_pad=float(card.value("matching.box_pad")),
        min_box_iou=float(card.value("matching.min_box_iou")),
        present_recall=float(card.value("scoring.present_recall")),
        max_axis_deg=float(card.value("scoring.max_axis_deg")),
        max_axis_apart=float(card.value("scoring.max_axis_apart")),
    )


@dataclass(frozen=True, kw_only=True)
class Present:
    """Shares of reference points that the submitted surface recalls; None where there are none.

    object: of the scored object a joint is of; part: of those inside the part's box.
    """

    object: float | None
    part: float | None


@dataclass(frozen=True, kw_only=True)
class _Match:
    """A submission's joint that corresponds to a reference one."""

    joint: SceneJoint
    iou: float
    axis_deg: float
    apart_m: float | None


def count_joints(
    reference: Sequence[ReferenceJoint],
    names: Mapping[int, str],
    submitted: Sequence[SceneJoint],
    present: Sequence[Present],
    rules: ArticulationRules,
) -> Articulation:
    """The pilot of one case.

    names: of scored objects by id; present: of each reference joint. A joint whose part is of no
    scored object is ignored, and so is what corresponds to it.
    """
    pairs = match_joints(reference, submitted, rules)
    rows: list[JointRow] = []
    for place, joint in enumerate(reference):
        match = None
        if place in pairs:
            other, iou = pairs[place]
            match = _match(joint, submitted[other], iou)
        outcome = _outcome(joint, match, present[place], rules)
        rows.append(_row(joint, names, match, outcome))
    taken = {other for other, _ in pairs.values()}
    extra = tuple(joint.part for k, joint in enumerate(submitted) if k not in taken)
    return _articulation(rows, extra)


def none_found(reference: Sequence[ReferenceJoint], names: Mapping[int, str]) -> Articulation:
    """The pilot of a case that is not valid: every joint's object is missing."""
    rows = [
        _row(joint, names, None, "ignored" if joint.object_id is None else "object_missing")
        for joint in reference
    ]
    return _articulation(rows, ())


def _articulation(rows: Sequence[JointRow], extra: tuple[str, ...]) -> Articulation:
    outcomes = Counter(_LETTER[row.outcome] for row in rows if row.outcome in _LETTER)
    counts = {letter: outcomes[letter] for letter in "CWPOJ"}
    score = articulation_score(**counts, E=len(extra))
    return Articulation(**counts, E=len(extra), score=score, joints=tuple(rows), extra=extra)


def articulation_score(*, C: int, W: int, P: int, O: int, J: int, E: int) -> float | None:  # noqa: E741, N803
    """2C / (2C + O + P + J + 2W + E); None where there is nothing to count."""
    whole = 2 * C + O + P + J + 2 * W + E
    return 2 * C / whole if whole else None


def sum_counts(counts: Sequence[JointCounts]) -> dict[str, int]:
    """The six counts over cases."""
    return {letter: sum(getattr(one, letter) for one in counts) for letter in "CWPOJE"}


def match_joints(
    reference: Sequence[ReferenceJoint], submitted: Sequence[SceneJoint], rules: ArticulationRules
) -> dict[int, tuple[int, float]]:
    """Which submitted joint answers to which reference joint, and the IoU of their parts' boxes.

    One to one, so that the sum of IoUs is largest; below the card's IoU nothing corresponds.
    """
    if not reference or not submitted:
        return {}
    iou = np.array([[_iou(g, q, rules.box_pad) for q in submitted] for g in reference])
    iou[iou < rules.min_box_iou] = 0.0
    rows, columns = linear_sum_assignment(-iou)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {g: (q, float(iou[g, q])) for g, q in pairs if iou[g, q] > 0}


def _iou(reference: SceneJoint, submitted: SceneJoint, pad: float) -> float:
    """Of two boxes that both grow by a share of the reference part's depth."""
    if reference.box_cam_m is None or submitted.box_cam_m is None:
        return 0.0
    grow = pad * _depth_m(reference)
    ours, theirs = (_grow_box(joint.box_cam_m, grow) for joint in (reference, submitted))
    both = np.clip(np.minimum(ours[1], theirs[1]) - np.maximum(ours[0], theirs[0]), 0.0, None)
    shared = float(np.prod(both))
    either = sum(float(np.prod(box[1] - box[0])) for box in (ours, theirs)) - shared
    return shared / either if either > 0 and math.isfinite(either) else 0.0


def _grow_box(box: tuple[Vector, Vector] | None, by: float) -> F64:
    corners = np.array(box, np.float64)
    return np.stack([corners[0] - by, corners[1] + by])


def _middle(joint: SceneJoint) -> F64:
    assert joint.box_cam_m is not None
    middle: NDArray[np.float64] = np.array(joint.box_cam_m, np.float64).mean(axis=0)
    return middle


def _depth_m(joint: SceneJoint) -> float:
    """Planar depth of the part's middle; 0 behind the camera."""
    return max(float(_middle(joint)[2]), 0.0)


def _match(reference: ReferenceJoint, submitted: SceneJoint, iou: float) -> _Match:
    ours, theirs = np.array(reference.axis_cam), np.array(submitted.axis_cam)
    cosine = min(1.0, abs(float(np.dot(ours, theirs))))
    apart = None
    if "prismatic" not in (reference.type, submitted.type):
        origin = np.array(reference.origin_cam_m)
        nearest = origin + np.dot(_middle(reference) - origin, ours) * ours
        offset = nearest - np.array(submitted.origin_cam_m)
        apart = float(np.linalg.norm(np.cross(offset, theirs)))
    return _Match(joint=submitted, iou=iou, axis_deg=math.degrees(math.acos(cosine)), apart_m=apart)


def _outcome(
    joint: ReferenceJoint, match: _Match | None, present: Present, rules: ArticulationRules
) -> Outcome:
    if joint.object_id is None:
        return "ignored"
    if match is not None:
        return "correct" if _is_correct(joint, match, rules) else "wrong"
    if present.object is None or present.object < rules.present_recall:
        return "object_missing"
    if present.part is not None and present.part < rules.present_recall:
        return "part_missing"
    return "joint_missing"


def _is_correct(joint: ReferenceJoint, match: _Match, rules: ArticulationRules) -> bool:
    slides = {one.type == "prismatic" for one in (joint, match.joint)}
    near = match.apart_m is None or match.apart_m <= rules.max_axis_apart * _depth_m(joint)
    return len(slides) == 1 and match.axis_deg <= rules.max_axis_deg and near


def _row(
    joint: ReferenceJoint, names: Mapping[int, str], match: _Match | None, outcome: Outcome
) -> JointRow:
    return JointRow(
        part=joint.part,
        object=None if joint.object_id is None else names[joint.object_id],
        type=joint.type,
        outcome=outcome,
        matched=match.joint.part if match else None,
        box_iou=match.iou if match else None,
        axis_deg=match.axis_deg if match else None,
        axis_apart_m=match.apart_m if match else None,
    )
