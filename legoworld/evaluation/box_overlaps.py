"""Volumes and exact IoU of boxes in space: kernels/solids.cpp behind ctypes.

A box is its eight corners in Omni3D's order, (8, 3) float64: 0 1 2 3 around one side, 4 5 6 7
behind them. Any parallelepiped will do, mirrored or sheared; a flat one has volume 0 and overlaps
nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from legoworld.evaluation.kernels.library import call

Floats = NDArray[np.float64]


def box_volumes(corners: ArrayLike) -> Floats:
    """(n,) volumes of (n, 8, 3) corners; 0 for a box that is flat to rounding."""
    boxes = np.ascontiguousarray(corners, np.float64)
    volumes = np.empty(len(boxes))
    call("lw_box_volumes", boxes, len(boxes), volumes)
    return volumes


def box_ious(corners: ArrayLike, others: ArrayLike) -> Floats:
    """(n, m) IoU of (n, 8, 3) and (m, 8, 3) corners; 0 where two boxes only touch."""
    mine, theirs = (np.ascontiguousarray(boxes, np.float64) for boxes in (corners, others))
    ious = np.empty((len(mine), len(theirs)))
    call("lw_box_ious", mine, len(mine), theirs, len(theirs), ious)
    return ious
