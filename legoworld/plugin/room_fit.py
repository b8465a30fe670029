"""A box room around a camera, from regions of its floor, ceiling and walls; no weights needed.

The camera stands inside a box whose sides run along the Manhattan frame, so each pixel's ray leaves
the box through exactly one face (Hedau et al. 2009). The distances are those that put the most
labelled pixels on the face their region is said to show. As one or two distances grow by a factor,
the score changes only where a pixel's ray changes its face: each step of the descent is exact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, get_args

import numpy as np
from numpy.typing import NDArray

from legoworld.records.plugin_evidence import FaceName, RoomFace, Rows, Structure

FACES: Final[tuple[FaceName, ...]] = get_args(FaceName)
WALLS: Final[tuple[FaceName, ...]] = ("left", "right", "far", "near")
#: Outward normals in the Manhattan frame, in the order of `FACES`.
NORMALS: Final[NDArray[np.float64]] = np.array(
    [(0, 0, -1), (0, 0, 1), (-1, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0)], np.float64
)
_MOST_PIXELS: Final = 20_000
#: First distances of walls and ceiling.
_STARTS: Final = ((1.2, 0.4), (2.5, 1.0), (5.0, 1.0))
#: Faces that are moved together, one alone first.
_MOVES: Final = tuple((i,) for i in range(6)) + tuple(combinations(range(6), 2))
_SWEEPS: Final = 30
#: Distances whose scores differ by less than this share of the pixels explain the photo as well.
_AS_WELL: Final = 0.001
#: A distance is known when those that explain the photo as well differ by at most this factor.
_WIDEST: Final = 1.25
_FARTHEST: Final = 1e3


@dataclass(frozen=True, kw_only=True)
class BoxFit:
    """The faces in the order of `FACES`, and the share of labelled pixels that they explain.

    distances: (6,) in camera heights, also of faces that are unknown.
    """

    faces: tuple[RoomFace, ...]
    distances: NDArray[np.float64]
    agreement: float
    labelled_px: int


def rays(rotation: Rows, hfov_deg: float, size_wh: tuple[int, int]) -> NDArray[np.float64]:
    """(H, W, 3) directions of the pixel centres in the Manhattan frame, planar z 1 in the camera's.

    rotation: world_from_cam, OpenCV camera axes; hfov_deg: of the whole width, square pixels.
    """
    width, height = size_wh
    focal = width / 2 / math.tan(math.radians(hfov_deg) / 2)
    u = (np.arange(width) + 0.5 - width / 2) / focal
    v = (np.arange(height) + 0.5 - height / 2) / focal
    in_cam = np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1)
    return np.asarray(in_cam @ np.array(rotation, np.float64).T)


def seen_face(directions: NDArray[np.float64], distances: NDArray[np.float64]) -> NDArray[np.int64]:
    """(...) index into `FACES` of the face that each of the (..., 3) rays leaves the box through.

    Equal distances go to the first face.
    """
    return np.asarray((distances / _towards(directions)).argmin(axis=-1))


def fit_box(
    directions: NDArray[np.float64], labels: Mapping[Structure, NDArray[np.bool_]]
) -> BoxFit:
    """The box whose faces explain the most labelled pixels, the floor at distance 1.

    directions: (H, W, 3) of `rays`; labels: (H, W) masks by what they show. "wall" is right on any
    of the four walls. ValueError without a labelled pixel.
    """
    allowed, towards, labelled_px = _samples(directions, labels)
    if not len(towards):
        raise ValueError("no pixel is labelled")
    best: tuple[int, NDArray[np.float64]] | None = None
    for wall, ceiling in _STARTS:
        distances = np.array([1.0, ceiling, wall, wall, wall, wall])
        score = _descend(distances, towards, allowed)
        if best is None or score > best[0]:
            best = score, distances
    assert best is not None
    score, distances = best
    faces = [_face(i, distances, towards, allowed) for i in range(len(FACES))]
    return BoxFit(
        faces=tuple(faces),
        distances=distances,
        agreement=score / len(towards),
        labelled_px=labelled_px,
    )


def _samples(
    directions: NDArray[np.float64], labels: Mapping[Structure, NDArray[np.bool_]]
) -> tuple[NDArray[np.bool_], NDArray[np.float64], int]:
    """(N, 6) faces each sampled pixel may lie on, (N, 6) how fast its ray nears each, and count.

    At most 20,000 pixels, evenly picked. A pixel of two structures may lie on either.
    """
    allowed = np.zeros((*directions.shape[:2], len(FACES)), bool)
    for structure, mask in labels.items():
        named: Sequence[FaceName] = WALLS if structure == "wall" else (structure,)
        for name in named:
            allowed[..., FACES.index(name)] |= mask
    rows = np.flatnonzero(allowed.any(axis=-1).ravel())
    picked = rows[:: max(1, math.ceil(len(rows) / _MOST_PIXELS))]
    return (
        allowed.reshape(-1, len(FACES))[picked],
        _towards(directions.reshape(-1, 3)[picked]),
        len(rows),
    )


def _towards(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 6) how fast rays near each face; a tiny number where they never do."""
    return np.maximum(directions @ NORMALS.T, 1e-12)


def _descend(
    distances: NDArray[np.float64], towards: NDArray[np.float64], allowed: NDArray[np.bool_]
) -> int:
    """Scale one face's distance or two faces' together, in place, until none improves; the score.

    The floor's, too: moving it alone is moving all others together. Its distance is 1 in the end.
    """
    score = -1
    for _ in range(_SWEEPS):
        before = score
        for moved in _MOVES:
            low, high, score = _best_scales(moved, distances, towards, allowed, as_well=0)
            if not low <= 1.0 <= high:
                distances[list(moved)] *= _middle(low, high)
        if score == before:
            break
    distances /= distances[0]
    return score


def _face(
    face: int,
    distances: NDArray[np.float64],
    towards: NDArray[np.float64],
    allowed: NDArray[np.bool_],
) -> RoomFace:
    low = high = 1.0
    if FACES[face] != "floor":  # whose distance is the unit
        as_well = math.ceil(_AS_WELL * len(towards))
        scales = _best_scales((face,), distances, towards, allowed, as_well=as_well)
        low, high = (float(distances[face]) * scale for scale in scales[:2])
    seen = (distances / towards).argmin(axis=1)
    own = allowed[:, face] & (allowed.sum(axis=1) == 1)
    unknown = None
    if not (allowed[:, face] & (seen == face)).any():
        unknown = "no labelled pixel lies on it"
    elif high > low * _WIDEST:
        end = "any farther one" if high > _FARTHEST else f"{high:.2f}"
        unknown = f"distances from {low:.2f} to {end} explain the photo as well"
    return RoomFace(
        name=FACES[face],
        distance=None if unknown else _middle(low, high),
        at_least=low,
        at_most=None if high > _FARTHEST else high,
        agreement=float((seen[own] == face).mean()) if own.any() else None,
        unknown=unknown,
    )


def _best_scales(
    moved: tuple[int, ...],
    distances: NDArray[np.float64],
    towards: NDArray[np.float64],
    allowed: NDArray[np.bool_],
    *,
    as_well: int,
) -> tuple[float, float, int]:
    """(low, high, score): factors of some faces' distances that explain the most pixels.

    A ray leaves through one of them exactly when the factor is below a threshold of its own; the
    score is a step function of these. as_well: the interval grows over neighbours that explain at
    most this many pixels fewer.
    """
    ways, rows = distances / towards, np.arange(len(towards))
    own = np.full_like(ways, np.inf)
    own[:, moved] = ways[:, moved]
    ways[:, moved] = np.inf
    near, other = own.argmin(axis=1), ways.argmin(axis=1)
    thresholds = ways[rows, other] / own[rows, near]
    on_moved, on_other = allowed[rows, near], allowed[rows, other]
    order = np.argsort(thresholds, kind="stable")
    # Beyond the first k thresholds, the first k rays leave through another face.
    gain = on_other[order].astype(np.int64) - on_moved[order]
    scores = int(on_moved.sum()) + np.concatenate([[0], np.cumsum(gain)])
    ends = np.concatenate([[0.0], thresholds[order], [np.inf]])
    proper = ends[1:] > ends[:-1] * (1 + 1e-12)
    best = int(scores[proper].max())
    first = last = int(np.flatnonzero(proper & (scores == best))[0])
    enough = ~proper | (scores >= best - as_well)
    while first > 0 and enough[first - 1]:
        first -= 1
    while last < len(scores) - 1 and enough[last + 1]:
        last += 1
    return float(ends[first]), float(ends[last + 1]), best


def _middle(low: float, high: float) -> float:
    """Between two distances, by ratio; beside the finite end where the other is open."""
    if high > _FARTHEST:
        return max(low * _WIDEST, 1e-3)
    return math.sqrt(max(low, 1e-3) * high) if high > 1e-3 else 1e-3
