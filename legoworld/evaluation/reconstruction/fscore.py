"""Precision, recall and F per object at every tolerance, and diagnostics of the whole surface.

By which submitted point answers to which reference point, object by object, and how far away it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from legoworld.evaluation.kernels.library import call
from legoworld.evaluation.reconstruction.nearest import GridSurface, hits_between, nearest_between
from legoworld.evaluation.reconstruction.points import (
    F64,
    Labels,
    Tolerance,
    finite_points,
)
from legoworld.records.reconstruction import PrecisionRecall


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


def match_surfaces(
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


def match_clouds(
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


@dataclass(frozen=True, kw_only=True)
class Score:
    """Points of one object (or of all as one) and how many of them are within tau.

    Recall is over reference points, precision over submitted ones, each submitted point held to the
    tau of the reference point nearest to it.
    """

    n_reference: int
    n_submitted: int
    reference_hits: int
    submitted_hits: int

    @property
    def recall(self) -> float:
        """Share of reference points that are hit, 0 where there is none."""
        return self.reference_hits / self.n_reference if self.n_reference else 0.0

    @property
    def precision(self) -> float:
        """Share of submitted points that hit, 0 where there is none."""
        return self.submitted_hits / self.n_submitted if self.n_submitted else 0.0

    @property
    def f1(self) -> float:
        """2 P R / (P + R), 0 where both are 0."""
        both = self.precision + self.recall
        return 2.0 * self.precision * self.recall / both if both > 0 else 0.0


def scores(pairs: Correspondence, objects: int, tolerance: Tolerance) -> list[Score]:
    """One score for each of labels 0 .. objects - 1."""
    hit_ref = pairs.reference_distance_m <= tolerance.tau_m(pairs.reference_z_m)
    hit_sub = pairs.submitted_distance_m <= tolerance.tau_m(pairs.nearest_z_m)
    columns = (
        _count_labels(pairs.reference_label, objects),
        _count_labels(pairs.submitted_label, objects),
        _count_labels(pairs.reference_label[hit_ref], objects),
        _count_labels(pairs.submitted_label[hit_sub], objects),
    )
    return [
        Score(n_reference=g, n_submitted=q, reference_hits=hit_g, submitted_hits=hit_q)
        for g, q, hit_g, hit_q in zip(*(c.tolist() for c in columns), strict=True)
    ]


def scores_on_rasters(
    reference: GridSurface,
    submitted: GridSurface,
    objects: int,
    tolerances: Sequence[Tolerance],
) -> list[list[Score]]:
    """`scores` of two surfaces at each tolerance, without any distance: several times as fast."""
    hits = hits_between(reference, submitted, objects, tolerances)
    sizes = list(zip(hits.n_a.tolist(), hits.n_b.tolist(), strict=True))
    return [
        [
            Score(n_reference=g, n_submitted=q, reference_hits=hit_g, submitted_hits=hit_q)
            for (g, q), hit_g, hit_q in zip(sizes, of_g, of_q, strict=True)
        ]
        for of_g, of_q in zip(hits.a.T.tolist(), hits.b.T.tolist(), strict=True)
    ]


def mean_f1(scores: list[Score]) -> float | None:
    """R: the unweighted mean of F over eligible objects, those that have a reference point."""
    values = [score.f1 for score in scores if score.n_reference]
    return float(np.mean(values)) if values else None


def _count_labels(label: Labels, objects: int) -> NDArray[np.int64]:
    return np.bincount(label, minlength=objects)


def precision_recall(score: Score) -> PrecisionRecall:
    """A score as a row holds it."""
    return PrecisionRecall(f1=score.f1, precision=score.precision, recall=score.recall)


def chamfer_over_diagonal(pairs: Correspondence, reference_m: F64) -> float | None:
    """Half the sum of both mean nearest distances, over the diagonal of the reference's box.

    pairs: of the visible scenes, under one label; reference_m: (N, 3) the reference-visible points,
    whose axis-aligned box in the camera frame it is. None without points, or with a single one.
    """
    if not len(pairs.reference_distance_m) or not len(pairs.submitted_distance_m):
        return None
    box = [float(np.ptp(axis)) for axis in reference_m.T]  # far faster than along the first axis
    diagonal = float(np.linalg.norm(box))
    both = float(np.mean(pairs.reference_distance_m)) + float(np.mean(pairs.submitted_distance_m))
    return both / 2.0 / diagonal if diagonal > 0 else None


def voxel_ious(reference_m: F64, submitted_m: F64, edges_m: Sequence[float]) -> list[float | None]:
    """Occupied voxels of both over those of either at each edge; None where none is.

    reference_m: (N, 3), submitted_m: (M, 3), finite. The grid is anchored at the camera: voxel k
    spans [k edge, (k + 1) edge); what lies over 2^20 voxels away is in the outermost one.
    """
    ours, theirs = (np.ascontiguousarray(cloud, np.float64) for cloud in (reference_m, submitted_m))
    assert ours.shape[1:] == theirs.shape[1:] == (3,)
    edges = np.array(edges_m, np.float64)
    both, either = (np.zeros(len(edges), np.int64) for _ in range(2))
    call("lw_voxels", ours, len(ours), theirs, len(theirs), edges, len(edges), both, either)
    pairs = zip(both.tolist(), either.tolist(), strict=True)
    return [shared / of if of else None for shared, of in pairs]
