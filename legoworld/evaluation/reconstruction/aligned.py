"""The submitted surface moved onto the reference: what R would be if an error were forgiven."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from legoworld.evaluation.reconstruction.points import F64, Depth, Flags
from legoworld.records.reconstruction import Registration

#: Points of each cloud that ICP works with, spread evenly over the raster's order.
ICP_POINTS: Final = 2000
ICP_ITERATIONS: Final = 30
#: Share of nearest pairs that a step is fitted to: the others are what the scenes do not share.
ICP_KEPT: Final = 0.8
#: ICP ends when a step moves the cloud by less than this, in radians and in metres a metre.
_ENOUGH: Final = 1e-6


def median_scaled(reference_z_m: Depth, submitted_z_m: Depth, both: Flags) -> Depth | None:
    """(H, W) depth times the median of reference / submitted where both are points, else None."""
    if not both.any():
        return None
    ratio = reference_z_m[both].astype(np.float64) / submitted_z_m[both]
    return _as_depth(submitted_z_m * float(np.median(ratio)))


def disparity_fitted(reference_z_m: Depth, submitted_z_m: Depth, both: Flags) -> Depth | None:
    """(H, W) 1 / (s / z + t), s and t by least squares in disparity where both are points.

    Where the fitted disparity is not positive nothing is left. None for fewer than two points, or
    for disparities that are all the same.
    """
    if int(both.sum()) < 2:
        return None
    x = 1.0 / submitted_z_m[both].astype(np.float64)
    y = 1.0 / reference_z_m[both].astype(np.float64)
    dx = x - x.mean()
    spread = float(np.dot(dx, dx))
    if not spread > 1e-12 * float(np.dot(x, x)):
        return None
    s = float(np.dot(dx, y - y.mean())) / spread
    t = float(y.mean()) - s * float(x.mean())
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        disparity = s / submitted_z_m.astype(np.float64) + t
        return _as_depth(np.where(disparity > 0, 1.0 / disparity, np.inf))


def _as_depth(values: NDArray[Any]) -> Depth:
    with np.errstate(over="ignore"):
        return np.asarray(values, np.float32)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """reference = rotation @ submitted + translation."""

    rotation: F64
    translation_m: F64
    registration: Registration

    def apply(self, points_m: F64) -> F64:
        """(N, 3) points after the motion."""
        return points_m @ self.rotation.T + self.translation_m


def trimmed_icp(reference_m: F64, submitted_m: F64) -> Motion | None:
    """The rigid motion from identity by trimmed ICP (Chetverikov et al. 2002), point to point.

    (n, 3) and (m, 3) points. Every step takes the 80 % nearest pairs of 2,000 points of each cloud
    and solves for the motion in closed form (Kabsch 1976). None with fewer than 3 on either side.
    """
    target, source = _thin_points(reference_m), _thin_points(submitted_m)
    if min(len(target), len(source)) < 3:
        return None
    nearest = MovingPairs(target)
    kept = max(3, int(ICP_KEPT * len(source)))
    rotation, translation = np.eye(3), np.zeros(3)
    size = float(np.abs(target).max())
    steps, rms = 0, 0.0
    while steps < ICP_ITERATIONS:
        steps += 1
        now = source @ rotation.T + translation
        distance, place = nearest.query(now)
        pairs = np.argsort(distance, kind="stable")[:kept]
        turn, shift = _kabsch(now[pairs], target[place[pairs]])
        rotation, translation = turn @ rotation, turn @ translation + shift
        rms = float(np.sqrt(np.mean(distance[pairs] ** 2)))
        moved = float(np.linalg.norm(turn @ now.mean(axis=0) + shift - now.mean(axis=0)))
        if angle_rad(turn) < _ENOUGH and moved < _ENOUGH * size:
            break
    registration = Registration(
        rotation_deg=float(np.degrees(angle_rad(rotation))),
        translation_m=float(np.linalg.norm(translation)),
        iterations=steps,
        trimmed_rms_m=rms,
    )
    return Motion(rotation=rotation, translation_m=translation, registration=registration)


class MovingPairs:
    """Nearest targets of a cloud that moves little from call to call: what a k-d tree answers.

    A point whose nearest target is closer than the second nearest was, less the way that the point
    has gone since the tree was asked, keeps its target.
    """

    #: More than rounding can make of a distance, as a share of it.
    _MARGIN: Final = 1e-9

    def __init__(self, target_m: F64) -> None:
        self._target = target_m
        self._tree = KDTree(target_m)
        self._asked_at: F64 | None = None
        self._place: NDArray[np.intp] = np.zeros(0, np.intp)
        self._second: F64 = np.zeros(0)

    def query(self, points_m: F64) -> tuple[F64, NDArray[np.intp]]:
        """Distance and place of the nearest target of each (N, 3) point."""
        if self._asked_at is None:
            self._asked_at = points_m.copy()
            self._place = np.zeros(len(points_m), np.intp)
            self._second = np.zeros(len(points_m))
            moved = np.arange(len(points_m))
        else:
            far = _lengths(points_m - self._target[self._place]) * (1.0 + self._MARGIN)
            gone = _lengths(points_m - self._asked_at) * (1.0 + self._MARGIN)
            moved = np.flatnonzero(far + gone >= self._second * (1.0 - self._MARGIN))
        if len(moved):
            answers = self._tree.query(points_m[moved], k=2)
            distance, place = (np.atleast_2d(answer) for answer in answers)
            self._place[moved] = place[:, 0]
            self._second[moved] = distance[:, 1]
            self._asked_at[moved] = points_m[moved]
        return _lengths(points_m - self._target[self._place]), self._place


def _lengths(vectors: F64) -> F64:
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def angle_rad(rotation: F64) -> float:
    """The angle that a (3, 3) rotation turns by, exact to rounding for small ones, too."""
    skew = rotation - rotation.T
    sine = 0.5 * float(np.linalg.norm([skew[2, 1], skew[0, 2], skew[1, 0]]))
    return float(np.arctan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0)))


def _thin_points(points_m: F64) -> F64:
    step = max(1, -(-len(points_m) // ICP_POINTS))
    return points_m[::step]


def _kabsch(source: F64, target: F64) -> tuple[F64, F64]:
    """Rotation and translation that bring source onto target with the least squares."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((source - a).T @ (target - b))
    mirrored = np.sign(np.linalg.det(vt.T @ u.T)) or 1.0
    rotation = vt.T @ np.diag([1.0, 1.0, mirrored]) @ u.T
    return rotation, b - rotation @ a
