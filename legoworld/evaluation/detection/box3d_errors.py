"""How boxes in space differ from their truths, beside the overlap: place, size, yaw."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from legoworld.records.detection import SpaceErrors
from legoworld.visibility.cuboids import edge_vectors

Floats = NDArray[np.float64]


class BoxErrors(NamedTuple):
    """Of n pairs.

    offset_m: (n, 3) from the true centre; size_ratio: (n, 3) of length, height and width; yaw_deg:
    (n,) modulo 90, in [0, 45].
    """

    offset_m: Floats
    size_ratio: Floats
    yaw_deg: Floats


def box_errors(corners: ArrayLike, true: ArrayLike) -> BoxErrors:
    """Of (n, 8, 3) corners and those of their truths; yaw about the true box's height."""
    mine, theirs = (np.array(c, np.float64).reshape(-1, 8, 3) for c in (corners, true))
    edges, true_edges = edge_vectors(mine), edge_vectors(theirs)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = [(edges[:, 0] * true_edges[:, k]).sum(1) for k in (0, 2)]
        lengths = [np.sqrt((true_edges[:, k] ** 2).sum(1)) for k in (0, 2)]
        angle = np.degrees(np.arctan2(along[1] / lengths[1], along[0] / lengths[0])) % 90
        ratio = _sizes(edges) / _sizes(true_edges)
    return BoxErrors(
        offset_m=mine.mean(axis=1) - theirs.mean(axis=1),
        size_ratio=ratio,
        yaw_deg=np.minimum(angle, 90 - angle),
    )


def _sizes(edges: Floats) -> Floats:
    x, y, z = np.sqrt((edges**2).sum(axis=2)).T
    return np.stack([np.maximum(x, z), y, np.minimum(x, z)], axis=1)


def space_errors(corners: ArrayLike, true: ArrayLike) -> SpaceErrors:
    """Medians over pairs; None where there is none."""
    errors = box_errors(corners, true)
    distance = np.sqrt((errors.offset_m**2).sum(axis=1))
    volume = errors.size_ratio.prod(axis=1)

    def median(values: Floats) -> float | None:
        known = values[np.isfinite(values)]
        return float(np.median(known)) if len(known) else None

    return SpaceErrors(
        pairs=len(distance),
        center_m=median(distance),
        volume_ratio=median(volume),
        yaw_mod_90_deg=median(errors.yaw_deg),
    )


def difference_said(corners: Floats, true: Floats) -> str:
    """One pair of (8, 3) corners in words."""
    errors = box_errors(corners[None], true[None])
    words = (("left", "right"), ("up", "down"), ("nearer", "farther"))
    offset = zip(errors.offset_m[0].tolist(), words, strict=True)
    place = ", ".join(f"{abs(v):.2f} m {pair[v > 0]}" for v, pair in offset)
    ratios = " x ".join(f"{v:.2f}" for v in errors.size_ratio[0].tolist())
    yaw = f"turned {errors.yaw_deg[0]:.0f} deg"
    return f"its centre is {place}; size {ratios} of the true one; {yaw}"
