"""R of one case, and the diagnostics beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from legoworld.evaluation.reconstruction import aligned
from legoworld.evaluation.reconstruction.dataset import BenchCase, BenchFolders
from legoworld.evaluation.reconstruction.fscore import (
    Correspondence,
    Score,
    chamfer_over_diagonal,
    match_clouds,
    match_surfaces,
    mean_f1,
    precision_recall,
    scores,
    scores_on_rasters,
    voxel_ious,
)
from legoworld.evaluation.reconstruction.nearest import GridSurface, share_raster
from legoworld.evaluation.reconstruction.points import (
    F64,
    Depth,
    Labels,
    finite_points,
    point_pixels,
    points_m,
)
from legoworld.evaluation.reconstruction.protocol import BenchProtocol, Choices
from legoworld.evaluation.reconstruction.reference import RASTER, Reference, load_cloud
from legoworld.evaluation.reconstruction.submission import Surface
from legoworld.records.reconstruction import Diagnostics, ObjectRow, Registration

#: The voxel edge that follows the scene: this share of the median reference depth.
_VOXEL_SHARE = 0.05


@dataclass(frozen=True, kw_only=True)
class PointMaps:
    """Both surfaces' (H, W, 3) points on the reference's raster, not finite where there is none.

    Diagnostics are taken from them, and A where the geometry agrees; made once, when one asks.
    """

    reference: Reference
    surface: Surface

    @cached_property
    def reference_m(self) -> F64:
        """Of the reference."""
        return points_m(self.reference.depth_z_m, self.reference.raster)

    @cached_property
    def submitted_m(self) -> F64:
        """Of the submission."""
        return points_m(self.surface.depth_z_m, self.reference.raster)


@dataclass(frozen=True, kw_only=True)
class GeometryScore:
    """r: R at the headline's tolerance; r_at: at the others, by name."""

    r: float
    r_at: dict[str, float]
    objects: tuple[ObjectRow, ...]
    diagnostics: Diagnostics | None
    registration: Registration | None


def geometry_score(
    folders: BenchFolders,
    case: BenchCase,
    reference: Reference,
    surface: Surface,
    points: PointMaps,
    protocol: BenchProtocol,
    choices: Choices,
) -> GeometryScore:
    """R of one submission. A case of which no object has a reference point has R = 0."""
    objects, tolerances = len(case.truth.scored), (protocol.headline, *protocol.others)
    if choices.sampling == RASTER:
        submitted = _grid(reference, surface.depth_z_m)
        f_scores = scores_on_rasters(_grid(reference), submitted, objects, tolerances)
    else:
        pairs = _other_sampling(folders, case, reference, surface, protocol, choices.sampling)
        f_scores = [scores(pairs, objects, tolerance) for tolerance in tolerances]
    main, others = (
        f_scores[0],
        {t.name: one for t, one in zip(protocol.others, f_scores[1:], strict=True)},
    )
    r = mean_f1(main) or 0.0
    diagnostics, registration = None, None
    if choices.diagnostics:
        own = r if choices.sampling == RASTER else None
        diagnostics, registration = _diagnostics(reference, surface, points, protocol, objects, own)
    return GeometryScore(
        r=r,
        r_at={name: mean_f1(found) or 0.0 for name, found in others.items()},
        objects=tuple(_object_rows(case, main, others)),
        diagnostics=diagnostics,
        registration=registration,
    )


def _object_rows(
    case: BenchCase, main: list[Score], others: Mapping[str, list[Score]]
) -> list[ObjectRow]:
    return [
        ObjectRow(
            id=scored.id,
            name=scored.name,
            category=scored.category,
            eligible=found.n_reference > 0,
            f1=found.f1,
            precision=found.precision,
            recall=found.recall,
            n_reference=found.n_reference,
            n_submitted=found.n_submitted,
            at={name: precision_recall(one[k]) for name, one in others.items()},
        )
        for k, (scored, found) in enumerate(zip(case.truth.scored, main, strict=True))
    ]


def _other_sampling(
    folders: BenchFolders,
    case: BenchCase,
    reference: Reference,
    surface: Surface,
    protocol: BenchProtocol,
    sampling: str,
) -> Correspondence:
    cloud = load_cloud(folders, case, sampling, protocol.depth_limit_m, protocol.point_cap)
    q = finite_points(surface.depth_z_m)
    submitted = points_m(surface.depth_z_m, reference.raster)[q]
    return match_clouds(cloud.points_m, cloud.label, submitted, cloud.submitted_label[q])


def _diagnostics(
    reference: Reference,
    surface: Surface,
    points: PointMaps,
    protocol: BenchProtocol,
    objects: int,
    r: float | None,
) -> tuple[Diagnostics, Registration | None]:
    """r: R on the raster where it is known, which own intrinsics that are the reference's give."""
    depth, raster = surface.depth_z_m, reference.raster
    g, q = finite_points(reference.depth_z_m), finite_points(depth)
    ours, theirs = points.reference_m[g], points.submitted_m[q]
    union = np.where(reference.label >= 0, 0, -1).astype(np.int32)
    everything = np.zeros_like(union)
    visible = match_surfaces(*share_raster(reference.depth_z_m, depth, everything, raster))
    of_objects = scores_on_rasters(
        _grid(reference, label=union), _grid(reference, depth, union), 1, (protocol.headline,)
    )[0]
    motion = aligned.trimmed_icp(ours, theirs)
    median_m = float(np.median(reference.depth_z_m[g])) if g.any() else None
    edges_m = (0.05, 0.1, *((_VOXEL_SHARE * median_m,) if median_m else ()))
    voxels = voxel_ious(ours, theirs, edges_m)
    scale = aligned.median_scaled(reference.depth_z_m, depth, g & q)
    shift = aligned.disparity_fitted(reference.depth_z_m, depth, g & q)
    diagnostics = Diagnostics(
        object_union=precision_recall(of_objects[0]),
        visible_scene=precision_recall(scores(visible, 1, protocol.headline)[0]),
        chamfer_l1_half_sum_over_reference_visible_box_diagonal=chamfer_over_diagonal(
            visible, ours
        ),
        voxel_iou_5_percent_of_median_depth=voxels[2] if median_m else None,
        voxel_iou_5cm=voxels[0],
        voxel_iou_10cm=voxels[1],
        R_median_scale=_r_of_depth(reference, scale, protocol, objects),
        R_disparity_scale_shift=_r_of_depth(reference, shift, protocol, objects),
        R_rigid=_r(reference, _move_surface(reference, depth, theirs, motion), protocol, objects)
        if motion
        else None,
        R_own_intrinsics=_r_own(reference, surface, protocol, objects, r),
    )
    return diagnostics, motion.registration if motion else None


def r_moved(
    reference: Reference, depth_z_m: Depth, motion: F64, protocol: BenchProtocol, objects: int
) -> float | None:
    """R of a submitted depth whose points are moved by a (4, 4) motion first."""
    registration = Registration(rotation_deg=0, translation_m=0, iterations=0, trimmed_rms_m=0)
    moved = aligned.Motion(
        rotation=motion[:3, :3], translation_m=motion[:3, 3], registration=registration
    )
    submitted_m = points_m(depth_z_m, reference.raster)[finite_points(depth_z_m)]
    surface = _move_surface(reference, depth_z_m, submitted_m, moved)
    return _r(reference, surface, protocol, objects)


def _move_surface(
    reference: Reference, depth_z_m: Depth, submitted_m: F64, motion: aligned.Motion
) -> GridSurface:
    """The submitted points after a motion, each in the mask of the pixel it then projects to.

    submitted_m: (N, 3) those of the depth, in raster order.
    """
    raster, q = reference.raster, finite_points(depth_z_m)
    pixel = point_pixels(motion.apply(submitted_m), raster)
    label = np.full(q.shape, -1, np.int32)
    label[q] = np.where(pixel >= 0, reference.label.ravel()[np.maximum(pixel, 0)], -1)
    rows = np.column_stack([motion.rotation, motion.translation_m])
    return GridSurface(depth_z_m=depth_z_m, label=label, raster=raster, motion=rows)


def _grid(
    reference: Reference, depth_z_m: Depth | None = None, label: Labels | None = None
) -> GridSurface:
    """A depth, or the reference's, in the reference's picture and masks, or others."""
    return GridSurface(
        depth_z_m=reference.depth_z_m if depth_z_m is None else depth_z_m,
        label=reference.label if label is None else label,
        raster=reference.raster,
    )


def _r_own(
    reference: Reference,
    surface: Surface,
    protocol: BenchProtocol,
    objects: int,
    r: float | None,
) -> float | None:
    """R of the surface as the submission's own camera sees it: its own rays and its own pixels."""
    if surface.own_depth_z_m is None or surface.own_raster is None:
        return r if r is not None else _r_of_depth(reference, surface.depth_z_m, protocol, objects)
    own = GridSurface(
        depth_z_m=surface.own_depth_z_m, label=reference.label, raster=surface.own_raster
    )
    return _r(reference, own, protocol, objects)


def _r_of_depth(
    reference: Reference, depth_z_m: Depth | None, protocol: BenchProtocol, objects: int
) -> float | None:
    if depth_z_m is None:
        return None
    return _r(reference, _grid(reference, depth_z_m), protocol, objects)


def _r(
    reference: Reference, submitted: GridSurface, protocol: BenchProtocol, objects: int
) -> float | None:
    return mean_f1(scores_on_rasters(_grid(reference), submitted, objects, (protocol.headline,))[0])
