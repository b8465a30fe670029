"""Which submitted point answers to which reference point, object by object, and how far away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from legoworld.evaluation.reconstruction.nearest import GridSurface, nearest_between
from legoworld.evaluation.reconstruction.points import F64, Depth, Labels, Raster, finite_points
from legoworld.evaluation.reconstruction.tolerance import Tolerance


@dataclass(frozen=True, kw_only=True)
class Correspondence:
    """Both clouds' points inside the masks, and each one's distance to the other cloud's nearest.

    reference_label, submitted_label: (N,) and (M,) position of the point's object;
    reference_z_m: (N,) planar z of reference points; nearest_z_m: (M,) that of the reference point
    nearest to each submitted one; distances are +inf where the other cloud has no point of the
    object (nearest_z_m is then 1). Made for tolerances, nothing but their hits may be read off it:
    see `nearest.Nearest`.
    """

    reference_label: Labels
    reference_z_m: F64
    reference_distance_m: F64
    submitted_label: Labels
    submitted_distance_m: F64
    nearest_z_m: F64


def on_one_raster(
    reference_z_m: Depth,
    submitted_z_m: Depth,
    label: Labels,
    raster: Raster,
    *,
    tolerances: Sequence[Tolerance] = (),
) -> Correspondence:
    """Of two depths on one raster. label: (H, W) object of each pixel, -1 for none."""
    reference, submitted = (
        GridSurface(depth_z_m=depth, label=label, raster=raster)
        for depth in (reference_z_m, submitted_z_m)
    )
    return on_two_rasters(reference, submitted, tolerances=tolerances)


def on_two_rasters(
    reference: GridSurface, submitted: GridSurface, *, tolerances: Sequence[Tolerance] = ()
) -> Correspondence:
    """Of two surfaces whose rasters are of one size."""
    ref, sub = nearest_between(reference, submitted, tolerances=tolerances)
    g = finite_points(reference.depth_z_m) & (reference.label >= 0)
    q = finite_points(submitted.depth_z_m) & (submitted.label >= 0)
    place = sub.index[q]
    z_m = reference.depth_z_m.ravel()
    nearest_z = np.where(place >= 0, z_m[np.maximum(place, 0)], 1.0)
    return Correspondence(
        reference_label=reference.label[g],
        reference_z_m=reference.depth_z_m[g].astype(np.float64),
        reference_distance_m=np.sqrt(ref.squared_m2[g]),
        submitted_label=submitted.label[q],
        submitted_distance_m=np.sqrt(sub.squared_m2[q]),
        nearest_z_m=nearest_z.astype(np.float64),
    )


def of_clouds(
    reference_m: F64, reference_label: Labels, submitted_m: F64, submitted_label: Labels
) -> Correspondence:
    """Of any two clouds, (N, 3) and (M, 3), with their labels, -1 for none: slower, as exact."""
    reference_m, reference_label = _select_labelled(reference_m, reference_label)
    submitted_m, submitted_label = _select_labelled(submitted_m, submitted_label)
    ref = np.full(len(reference_m), np.inf)
    sub = np.full(len(submitted_m), np.inf)
    nearest_z = np.ones(len(submitted_m))
    for k in np.intersect1d(reference_label, submitted_label):
        g, q = reference_label == k, submitted_label == k
        ref[g], _ = KDTree(submitted_m[q]).query(reference_m[g])
        sub[q], place = KDTree(reference_m[g]).query(submitted_m[q])
        nearest_z[q] = reference_m[g][place, 2]
    return Correspondence(
        reference_label=reference_label,
        reference_z_m=reference_m[:, 2],
        reference_distance_m=ref,
        submitted_label=submitted_label,
        submitted_distance_m=sub,
        nearest_z_m=nearest_z,
    )


def _select_labelled(points_m: F64, label: Labels) -> tuple[F64, NDArray[np.int32]]:
    kept = label >= 0
    return points_m[kept], label[kept]
