"""Numbers of the whole visible surface, beside R and never in it (docs/protocols/bench.md)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.reconstruction.correspondence import Correspondence
from legoworld.evaluation.reconstruction.fscore import Score
from legoworld.evaluation.reconstruction.points import F64
from legoworld.records.reconstruction_rows import PrecisionRecall

#: Voxels from the camera in each direction; what lies beyond is in the outermost one.
_REACH: Final = 1 << 20


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
    diagonal = float(np.linalg.norm(reference_m.max(axis=0) - reference_m.min(axis=0)))
    both = float(np.mean(pairs.reference_distance_m)) + float(np.mean(pairs.submitted_distance_m))
    return both / 2.0 / diagonal if diagonal > 0 else None


def voxel_iou(reference_m: F64, submitted_m: F64, edge_m: float) -> float | None:
    """Occupied voxels of both over those of either, (N, 3) and (M, 3); None where none is.

    The grid is anchored at the camera: voxel k spans [k edge, (k + 1) edge).
    """
    ours, theirs = (_occupied(cloud, edge_m) for cloud in (reference_m, submitted_m))
    both = len(np.intersect1d(ours, theirs, assume_unique=True))
    either = len(ours) + len(theirs) - both
    return both / either if either else None


def _occupied(points_m: F64, edge_m: float) -> NDArray[np.int64]:
    """Each occupied voxel's number, ascending."""
    packed = np.zeros(len(points_m), np.int64)
    for axis in range(3):
        cell = points_m[:, axis] / edge_m
        np.clip(np.floor(cell, out=cell), -_REACH, _REACH - 1, out=cell)
        packed <<= 21
        packed |= cell.astype(np.int64) + _REACH
    # Neighbours on the raster mostly share a voxel: most repeats go before they are sorted.
    found: NDArray[np.int64] = np.unique(packed[np.flatnonzero(np.diff(packed, prepend=-1))])
    return found
