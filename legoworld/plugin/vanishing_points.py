"""Camera rotation from a photo of a Manhattan world, given its field of view; no weights needed.

Line segments (von Gioi et al. 2010, OpenCV's LSD) are calibrated into planes through the camera
centre. A rotation explains a segment when its plane holds one of three orthogonal directions
(Coughlan and Yuille 1999). Rotations are proposed from pairs of segments for one direction and a
third for the next (Bazin and Pollefeys 2012), scored by the length they explain, and refined.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Segments shorter than this share of the picture's diagonal are mostly texture.
_SHORTEST: Final = 0.02
_MOST_SEGMENTS: Final = 300
_FEWEST_SEGMENTS: Final = 8
_PROPOSALS: Final = 4000
#: A segment is explained by a direction this close to its plane.
_INLIER_DEG: Final = 1.5
#: Below this share of explained length, or with one direction only, the photo does not tell.
_LEAST_EXPLAINED: Final = 0.5
_LEAST_OF_A_DIRECTION: Final = 0.05
#: Up is known where the next direction needs so much more tilt of the camera.
_APART_DEG: Final = 15.0
_SEED: Final = 0


@dataclass(frozen=True, kw_only=True)
class ManhattanCamera:
    """world_from_cam: (3, 3) rotation, camera axes x right, y down, z forward, world z up.

    The world's x is the horizontal Manhattan direction nearest to the camera's right.
    explained_share: share of the segments' length that lies along one of the three directions.
    """

    world_from_cam: NDArray[np.float64]
    explained_share: float
    n_segments: int


class UndeterminedError(Exception):
    """The photo does not tell its camera's rotation; the text says why."""


def manhattan_camera(gray: NDArray[np.uint8], hfov_deg: float) -> ManhattanCamera:
    """The camera's rotation to the world of the photo's walls; UndeterminedError if unknown.

    gray: (H, W) uint8; hfov_deg: horizontal field of view of the whole width; the principal point
    is taken in the middle. The same photo gives the same answer.
    """
    height, width = gray.shape
    focal = width / 2 / math.tan(math.radians(hfov_deg) / 2)
    normals, lengths = _planes(_segments(gray), focal, (width / 2, height / 2))
    if len(lengths) < _FEWEST_SEGMENTS:
        raise UndeterminedError(f"{len(lengths)} line segments, fewer than {_FEWEST_SEGMENTS}")
    axes = _refine_axes(_best_proposal(normals, lengths), normals, lengths)
    share = _explained_share(axes[None], normals, lengths)
    per_direction = _support(axes, normals, lengths) / lengths.sum()
    if share[0] < _LEAST_EXPLAINED:
        raise UndeterminedError(
            f"three directions explain {share[0]:.0%} of the lines, less than half"
        )
    if int((per_direction >= _LEAST_OF_A_DIRECTION).sum()) < 2:
        raise UndeterminedError("all lines run along one direction")
    return ManhattanCamera(
        world_from_cam=_upright(axes), explained_share=float(share[0]), n_segments=len(lengths)
    )


def _segments(gray: NDArray[np.uint8]) -> NDArray[np.float64]:
    """(N, 4) float64: x0, y0, x1, y1 in pixels, centres at .5, longest first."""
    import cv2

    detected = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(gray)[0]
    if detected is None:
        return np.empty((0, 4), np.float64)
    segments = detected[:, 0].astype(np.float64) + 0.5
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    order = np.lexsort((*segments.T[::-1], -lengths))
    kept = order[lengths[order] >= _SHORTEST * math.hypot(*gray.shape)]
    return np.asarray(segments[kept[:_MOST_SEGMENTS]])


def _planes(
    segments: NDArray[np.float64], focal: float, centre: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) unit normals of the planes through the camera and the segments; (N,) lengths."""
    rays = np.ones((len(segments), 2, 3))
    rays[:, :, :2] = (segments.reshape(-1, 2, 2) - centre) / focal
    normals = np.cross(rays[:, 0], rays[:, 1])
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True), lengths


def _best_proposal(
    normals: NDArray[np.float64], lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    random = np.random.default_rng(_SEED)
    share = lengths / lengths.sum()
    picks = random.choice(len(normals), size=(_PROPOSALS, 3), p=share)
    first = np.cross(normals[picks[:, 0]], normals[picks[:, 1]])
    second = np.cross(normals[picks[:, 2]], first)
    sizes = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    proper = (sizes[0] > 1e-3) & (sizes[1] > 1e-6)
    first, second = first[proper] / sizes[0][proper, None], second[proper] / sizes[1][proper, None]
    if not len(first):
        raise UndeterminedError("all lines meet in one point")
    axes = np.stack([first, second, np.cross(first, second)], axis=1)
    return np.asarray(axes[int(np.argmax(_explained_share(axes, normals, lengths)))])


def _explained_share(
    axes: NDArray[np.float64], normals: NDArray[np.float64], lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(P,) share of length near one of the (P, 3, 3) directions, nearer counting more."""
    away = np.abs(np.einsum("pij,nj->pin", axes, normals)).min(axis=1)
    weight = np.maximum(0.0, 1.0 - (away / math.sin(math.radians(_INLIER_DEG))) ** 2)
    return np.asarray(((weight > 0) * lengths).sum(axis=1) / lengths.sum())


def _support(
    axes: NDArray[np.float64], normals: NDArray[np.float64], lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(3,) length of the segments that each direction explains best."""
    away = np.abs(axes @ normals.T)
    near = away.min(axis=0) < math.sin(math.radians(_INLIER_DEG))
    return np.asarray(np.bincount(away.argmin(axis=0)[near], lengths[near], 3), np.float64)


def _refine_axes(
    axes: NDArray[np.float64], normals: NDArray[np.float64], lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Alternate: each segment to its direction, then the rotation with the least weighted squares.

    Of a small turn w, direction a moves by w x a; n . (a + w x a) = 0 is linear in w.
    """
    for limit_deg in (2 * _INLIER_DEG, _INLIER_DEG, _INLIER_DEG / 2, _INLIER_DEG / 2):
        for _ in range(5):
            away = axes @ normals.T
            nearest = np.abs(away).argmin(axis=0)
            at = away[nearest, np.arange(len(normals))]
            near = np.abs(at) < math.sin(math.radians(limit_deg))
            if near.sum() < 3:
                return axes
            rows = np.cross(axes[nearest[near]], normals[near])
            weight = np.sqrt(lengths[near])
            turn = np.linalg.lstsq(rows * weight[:, None], -at[near] * weight, rcond=None)[0]
            axes = axes @ _rotation(turn).T
    return axes


def _rotation(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(turn))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = turn / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k)


def _upright(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Name the directions: up needs the least roll and pitch, x is nearest to the picture's right.

    UndeterminedError where another direction could be up as well: a camera that looks down by 48
    degrees along a wall sees the lines of one that looks up by 42.
    """
    tilts = [_tilt_deg(axis) for axis in axes]
    first, second, _ = np.argsort(tilts, kind="stable").tolist()
    if tilts[second] - tilts[first] < _APART_DEG:
        raise UndeterminedError("two directions of the lines could be up")
    up = axes[first]
    z = -up * np.sign(up[1])
    others = [i for i in range(3) if i != first]
    right = max(others, key=lambda i: abs(float(axes[i, 0])))
    x = axes[right] * (np.sign(axes[right, 0]) or 1.0)
    return np.stack([x, np.cross(z, x), z])


def _tilt_deg(axis: NDArray[np.float64]) -> float:
    """How far a camera with this direction up is from upright, degrees; roll counts twice."""
    x, y, z = (axis * -(np.sign(axis[1]) or 1.0)).tolist()
    roll, pitch = math.atan2(x, -y), math.asin(min(1.0, max(-1.0, z)))
    return math.degrees(math.hypot(2 * roll, pitch))
