"""The camera that VGGT recovers, in pixels of the photo."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vggt_input import Fit


class NoCameraError(ValueError):
    """The network's answer is no pinhole camera."""


def photo_camera(intrinsics_px: NDArray[np.float64], placed: Fit) -> dict[str, Any]:
    """{"width", "height", "fx", "fy", "cx", "cy"} of the stored photo. NoCameraError.

    intrinsics_px: (3, 3) in pixels of the network's picture, origin in its upper left corner. A
    point x of that picture shows the photo's (x - origin) * photo / resized, so the focal lengths
    are scaled by photo / resized, each side by its own, and the principal point moves, too.
    """
    found: dict[str, Any] = {"width": placed.photo_wh[0], "height": placed.photo_wh[1]}
    for axis, name in enumerate("xy"):
        scale = placed.photo_wh[axis] / placed.resized_wh[axis]
        focal = float(intrinsics_px[axis, axis]) * scale
        centre = (float(intrinsics_px[axis, 2]) - placed.origin_xy[axis]) * scale
        if not (math.isfinite(focal) and focal > 0 and math.isfinite(centre)):
            raise NoCameraError(
                f"the network's answer is no camera: f{name} {focal}, c{name} {centre}"
            )
        found |= {f"f{name}": focal, f"c{name}": centre}
    return found
