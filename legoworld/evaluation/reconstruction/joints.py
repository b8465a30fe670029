"""The articulation pilot of one case: its joints against the submission's, and what is there."""

from __future__ import annotations

import numpy as np

from legoworld.evaluation.reconstruction.articulation import (
    Present,
    articulation_rules,
    count_joints,
    none_found,
)
from legoworld.evaluation.reconstruction.dataset import BenchCase
from legoworld.evaluation.reconstruction.nearest import nearest_between, share_raster
from legoworld.evaluation.reconstruction.points import (
    F64,
    Tolerance,
    finite_points,
    hit_share,
    points_m,
)
from legoworld.evaluation.reconstruction.reference import Reference
from legoworld.evaluation.reconstruction.submission import Surface
from legoworld.records.base import UNSET, UnsetType
from legoworld.records.bench_dataset import Articulation, ReferenceJoint
from legoworld.records.submission import BenchRow
from legoworld.records.track import Vector


def not_valid(case: BenchCase) -> Articulation | UnsetType:
    """Of a submission that is not valid; UNSET where the reference has no joint."""
    joints = case.truth.joints
    return UNSET if joints is UNSET else none_found(joints, _names(case))


def score_articulation(
    case: BenchCase, row: BenchRow, reference: Reference, surface: Surface, relative: float
) -> Articulation | UnsetType:
    """Of a compared submission; UNSET where the reference has no joint, or none were looked for.

    relative: R's tolerance, as a share of depth, by which objects and parts are there.
    """
    joints = case.truth.joints
    if joints is UNSET or row.integrity is UNSET:
        return UNSET
    submitted = () if row.joints is UNSET else row.joints
    present = _present(case, joints, reference, surface, relative)
    return count_joints(joints, _names(case), submitted, present, articulation_rules())


def _names(case: BenchCase) -> dict[int, str]:
    return {scored.id: scored.name for scored in case.truth.scored}


def _present(
    case: BenchCase,
    joints: tuple[ReferenceJoint, ...],
    reference: Reference,
    surface: Surface,
    relative: float,
) -> list[Present]:
    """Recall of the reference points of each joint's object, and of those in its part's box."""
    tolerance = Tolerance(name="present", relative=relative)
    surfaces = share_raster(
        reference.depth_z_m, surface.depth_z_m, reference.label, reference.raster
    )
    near, _ = nearest_between(*surfaces, tolerances=(tolerance,))
    points = points_m(reference.depth_z_m, reference.raster)
    known = finite_points(reference.depth_z_m)
    with np.errstate(over="ignore"):
        tau = tolerance.tau_m(reference.depth_z_m.astype(np.float64))
        hits = np.sqrt(near.squared_m2) <= tau
    place = {scored.id: k for k, scored in enumerate(case.truth.scored)}
    present = []
    for joint in joints:
        if joint.object_id is None or joint.box_cam_m is None:
            present.append(Present(object=None, part=None))
            continue
        of_object = known & (reference.label == place[joint.object_id])
        low, high = _bounds(joint.box_cam_m)
        in_box = of_object & (points >= low).all(axis=2) & (points <= high).all(axis=2)
        present.append(Present(object=hit_share(hits, of_object), part=hit_share(hits, in_box)))
    return present


def _bounds(box_cam_m: tuple[Vector, Vector]) -> tuple[F64, F64]:
    """The box's corners, moved out by what rounding of a stored depth may move a point."""
    low, high = (np.array(corner, np.float64) for corner in box_cam_m)
    slack = 1e-5 * float(np.abs([low, high]).max())
    return low - slack, high + slack
