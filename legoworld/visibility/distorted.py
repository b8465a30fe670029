"""A view through a distorting lens: a finer pinhole picture, looked up at each pixel's ray.

A pixel shows the sample of the pinhole picture that is nearest to its ray, at most a quarter of
a pixel away where the lens does not magnify. Depth along the optical axis is that of the sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.visibility.kernel import MAX_SIDE
from legoworld.visibility.lens import Lens, undistort
from legoworld.visibility.projection import Projection

#: Samples of the pinhole picture along a pixel's side.
_FINER: Final = 2


@dataclass(frozen=True, kw_only=True)
class LensMap:
    """Which sample of a pinhole picture each pixel shows.

    projection, size_wh: of the pinhole picture. index: (H, W) int64 into its pixels row by row;
    valid: (H, W) bool, False where no ray in front of the camera reaches the pixel.
    """

    projection: Projection
    size_wh: tuple[int, int]
    index: NDArray[np.int64]
    valid: NDArray[np.bool_]

    def look_up(self, picture: NDArray[Any], nothing: float) -> NDArray[Any]:
        """A picture (h, w, ...) of the pinhole as the lens shows it; nothing: where not valid."""
        flat = picture.reshape(-1, *picture.shape[2:])
        seen = flat[self.index]
        seen[~self.valid] = nothing
        return seen


def lens_map(lens: Lens, pinhole: Projection, size_wh: tuple[int, int]) -> LensMap:
    """The map of a lens. pinhole: the projection without the lens, perspective.

    LegoWorldError where no pixel has a ray, or the rays need a picture that is too large.
    """
    width, height = size_wh
    centres = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    found = undistort(
        lens, (pinhole.fx, pinhole.fy), (pinhole.cx, pinhole.cy), centres.reshape(-1, 2)
    ).xy_px
    # The rays of a wide fisheye go far out: what no picture can hold is not valid.
    half = MAX_SIDE / _FINER / 2 - 1
    near = np.abs(found - [pinhole.cx, pinhole.cy]).max(axis=1) < half
    valid = near & np.isfinite(found).all(axis=1)
    if not valid.any():
        raise LegoWorldError(
            "the lens has no ray for any pixel",
            found=f"coefficients {lens.coefficients}",
            expected="a distortion that is invertible, of a camera of these pixels",
        )
    left, top = np.floor(found[valid].min(axis=0))
    right, bottom = np.ceil(found[valid].max(axis=0))
    # Sample n of a side is at left + n / 2: pixel centres of an undistorted picture are samples.
    columns = np.rint((found[:, 0] - left) * _FINER)
    rows = np.rint((found[:, 1] - top) * _FINER)
    size = int(right - left) * _FINER + 1, int(bottom - top) * _FINER + 1
    index = np.where(valid, rows * size[0] + columns, 0).astype(np.int64)
    return LensMap(
        projection=replace(
            pinhole,
            fx=pinhole.fx * _FINER,
            fy=pinhole.fy * _FINER,
            cx=(pinhole.cx - left) * _FINER + 0.5,
            cy=(pinhole.cy - top) * _FINER + 0.5,
        ),
        size_wh=size,
        index=index.reshape(height, width),
        valid=valid.reshape(height, width),
    )
