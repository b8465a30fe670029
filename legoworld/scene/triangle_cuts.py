"""What cuts a snapshot's triangles in part, as both readers of scenes make it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class TriangleCuts:
    """Alpha within triangles.

    cut: (T,) int32 index of a cut-out, -1 for none; uv: (T, 3, 2) float32, v upwards; alpha:
    (T, 3) float32 at the corners, None for 1.
    """

    cut: NDArray[np.int32]
    uv: NDArray[np.float32]
    alpha: NDArray[np.float32] | None


def cut_arrays(parts: Sequence[tuple[TriangleCuts | None, int]]) -> dict[str, Any]:
    """The arrays of a Snapshot. parts: the cuts of each of its meshes and its number of triangles.

    corner_alpha is left out where no part has one.
    """
    cuts = [cut or _no_cuts(n_triangles) for cut, n_triangles in parts]
    made = {
        "triangle_cutout": np.concatenate([c.cut for c in cuts]),
        "corner_uv": np.ascontiguousarray(np.concatenate([c.uv for c in cuts])),
    }
    if any(c.alpha is not None for c in cuts):
        made["corner_alpha"] = np.concatenate(
            [np.ones((len(c.cut), 3), np.float32) if c.alpha is None else c.alpha for c in cuts]
        )
    return made


def _no_cuts(n_triangles: int) -> TriangleCuts:
    uv = np.zeros((n_triangles, 3, 2), np.float32)
    return TriangleCuts(cut=np.full(n_triangles, -1, np.int32), uv=uv, alpha=None)
