"""Numbers of the whole visible surface, beside R and never in it (docs/protocols/bench.md)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np

from legoworld.evaluation.kernels.library import check, library, pointer
from legoworld.evaluation.reconstruction.correspondence import Correspondence
from legoworld.evaluation.reconstruction.fscore import Score
from legoworld.evaluation.reconstruction.points import F64
from legoworld.records.reconstruction import PrecisionRecall


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
    check(
        library().lw_voxels(
            pointer(ours), ctypes.c_int64(len(ours)), pointer(theirs), ctypes.c_int64(len(theirs)),
            pointer(edges), ctypes.c_int64(len(edges)), pointer(both), pointer(either),
        )
    )  # fmt: skip
    pairs = zip(both.tolist(), either.tolist(), strict=True)
    return [shared / of if of else None for shared, of in pairs]
