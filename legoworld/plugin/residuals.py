"""Residuals in the picture: a visible mask against an image region, and depth against depth.

Pixels and masks are arrays at the photo's size; every function is pure. None is an unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]

#: Fewer pixels than this tell nothing about a shape.
SMALLEST_PX: Final = 16
#: One affine fit has two unknowns; with fewer regions its residual says nothing.
FEWEST_REGIONS: Final = 3


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A mask in numbers. centroid_uv: pixel centres; extent_xywh: whole pixels; all in pixels."""

    area_px: int
    centroid_uv: tuple[float, float]
    extent_xywh: tuple[int, int, int, int]


def measure_shape(mask: Mask) -> Shape | None:
    """The area, centroid and extent of an (H, W) mask; None for an empty one."""
    # Far quicker than np.nonzero over two axes.
    rows, columns = np.divmod(np.flatnonzero(mask), mask.shape[1])
    if not len(rows):
        return None
    x, y = int(columns.min()), int(rows.min())
    width, height = int(columns.max()) + 1 - x, int(rows.max()) + 1 - y
    # Sums of integers, exact in any order.
    centroid = (int(columns.sum()) / len(rows) + 0.5, int(rows.sum()) / len(rows) + 0.5)
    return Shape(area_px=len(rows), centroid_uv=centroid, extent_xywh=(x, y, width, height))


def centroid_offset(mask: Shape, region: Shape, size_wh: tuple[int, int]) -> tuple[float, float]:
    """(du / W, dv / H): how far the mask's centroid is right of and below the region's."""
    du = mask.centroid_uv[0] - region.centroid_uv[0]
    dv = mask.centroid_uv[1] - region.centroid_uv[1]
    return du / size_wh[0], dv / size_wh[1]


def extent_ratio(mask: Shape, region: Shape) -> tuple[float, float]:
    """(log of the width ratio, log of the height ratio), mask over region."""
    w, h = (np.log(mask.extent_xywh[i] / region.extent_xywh[i]) for i in (2, 3))
    return float(w), float(h)


def overlap(mask: Mask, region: Mask) -> float:
    """Intersection over union of two (H, W) masks; 0 where both are empty."""
    union = int(np.count_nonzero(mask | region))
    return int(np.count_nonzero(mask & region)) / union if union else 0.0


def boundary_distance_px(mask: Mask, region: Mask) -> float:
    """Half the sum of both mean distances from one outline's pixels to the other outline.

    Masks: (H, W). Their outlines are the pixels with a 4-neighbour outside of mask or picture.
    """
    # Both outlines lie in the box around both: distances there are those of the whole picture.
    box = _box(mask | region)
    first, second = (np.argwhere(outline(m[box])) for m in (mask, region))
    return (_mean_distance(first, second) + _mean_distance(second, first)) / 2


def _mean_distance(points: NDArray[np.int64], others: NDArray[np.int64]) -> float:
    """Mean over points of the distance to the nearest of others.

    Exact: OpenCV's distance transform differs from call to call in the ninth digit.
    """
    from scipy.spatial import KDTree

    return float(KDTree(others).query(points)[0].mean())


def _box(mask: Mask) -> tuple[slice, slice]:
    """The rows and columns of a mask's extent."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def outline(mask: Mask) -> Mask:
    """The pixels of an (H, W) mask that have a 4-neighbour which is not its own."""
    padded = np.pad(mask, 1)
    inside = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return np.asarray(mask & ~inside)


@dataclass(frozen=True, kw_only=True)
class DepthFit:
    """1 / z = a * d + b: the scene's depth in metres from the photo's disparity d."""

    a: float
    b: float

    def depth_m(self, disparity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Depth, in the shape of disparity, where the fit gives a positive one, else NaN."""
        inverse = self.a * disparity + self.b
        return np.divide(1.0, inverse, out=np.full_like(inverse, np.nan), where=inverse > 0)


def median_pair(
    depth_z_m: NDArray[np.float32], disparity: NDArray[np.float64], both: Mask
) -> tuple[float, float] | None:
    """Medians over `both`, (H, W): (1 / z in 1 / metres, disparity). None below 16 px."""
    z, known = _paired_values(depth_z_m, disparity, both)
    if len(z) < SMALLEST_PX:
        return None
    return float(np.median(1.0 / z)), float(np.median(known))


def _paired_values(
    depth_z_m: NDArray[np.float32], disparity: NDArray[np.float64], both: Mask
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N,) depth and disparity of a mask's pixels where both are known."""
    at = np.flatnonzero(both)
    z, known = depth_z_m.ravel()[at], disparity.ravel()[at]
    usable = np.isfinite(z) & (z > 0) & np.isfinite(known)
    return z[usable].astype(np.float64), known[usable]


def fit_depth(pairs: Sequence[tuple[float, float]]) -> DepthFit | None:
    """Least squares over the regions' medians, each region counted once.

    None with fewer than three regions, without spread, or where nearer would be farther (a <= 0).
    """
    if len(pairs) < FEWEST_REGIONS:
        return None
    inverse, disparity = np.array(pairs, np.float64).T
    centred = disparity - disparity.mean()
    spread = float((centred**2).sum())
    if spread <= 1e-12 * max(1.0, float((disparity**2).sum())):
        return None
    a = float((centred * (inverse - inverse.mean())).sum()) / spread
    return DepthFit(a=a, b=float(inverse.mean() - a * disparity.mean())) if a > 0 else None


def depth_residual(
    fit: DepthFit, depth_z_m: NDArray[np.float32], disparity: NDArray[np.float64], both: Mask
) -> float | None:
    """Median of log(z of the scene / z of the fit) over the pixels of `both`, (H, W), signed."""
    z, known = _paired_values(depth_z_m, disparity, both)
    expected = fit.depth_m(known)
    kept = np.isfinite(expected)
    if np.count_nonzero(kept) < SMALLEST_PX:
        return None
    ratios = z[kept] / expected[kept]
    return float(np.median(np.log(ratios)))


def inversions(first: Sequence[float], second: Sequence[float]) -> tuple[float, float]:
    """Share of pairs in opposite order, and Kendall's tau-a; a tie on either side is neither."""
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    upper = np.triu_indices(len(a), 1)
    signs = (np.sign(a[:, None] - a[None]) * np.sign(b[:, None] - b[None]))[upper]
    return float((signs < 0).mean()), float(signs.mean())
