"""How camera coordinates become pixels."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Projection:
    """A camera without a pose. Camera frame is OpenCV's: x right, y down, z forward.

    perspective: u = cx + fx*x/z, v = cy + fy*y/z; orthographic: u = cx + fx*x, v = cy + fy*y.
    Pixel (r, c) is sampled at its centre (u, v) = (c + 0.5, r + 0.5).
    fx, fy: pixels (orthographic: pixels per scene unit); z_near, z_far: planar z in scene units,
    both inclusive.
    """

    orthographic: bool
    fx: float
    fy: float
    cx: float
    cy: float
    z_near: float
    z_far: float
