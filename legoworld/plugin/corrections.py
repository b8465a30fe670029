"""What would take a residual to zero, all else left as it is: a move, a scale, a turn.

First order in the picture: an entity's pixels are taken to lie at one depth. Corrections of several
requirements are not added: measure again after each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.plugin.residuals import Shape, centroid_offset, extent_ratio
from legoworld.records.plugin_requirements import Correction
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.camera import projection

F64 = NDArray[np.float64]
#: A move on the ground that is this much longer than the one in the picture's plane is no answer:
#: the camera looks along the ground.
_LONGEST: Final = 5.0


@dataclass(frozen=True, kw_only=True)
class ViewedEntity:
    """An entity in a picture. depth_m: along the camera's axis; middle_m: of its world box."""

    snapshot: Snapshot
    size_wh: tuple[int, int]
    depth_m: float
    middle_m: F64

    def towards(self, own: Shape, region: Shape, *, scaled: bool) -> Correction:
        """To a region's centroid, by a move in the picture's plane and one on the ground.

        scaled: also to its extent.
        """
        du, dv = centroid_offset(own, region, self.size_wh)
        shift_px = np.array([-du * self.size_wh[0], -dv * self.size_wh[1]])
        jacobian = self._pixels_per_metre()
        in_plane = self._axes() @ np.append(
            np.linalg.solve(jacobian @ self._axes()[:, :2], shift_px), 0.0
        )
        return Correction(
            move_m=as_triple(in_plane),
            on_ground_m=self._on_ground(jacobian, shift_px, float(np.linalg.norm(in_plane))),
            scale=self.fit(own, region).scale if scaled else None,
        )

    def fit(self, own: Shape, region: Shape) -> Correction:
        """To a region's extent: a scale about the entity's own middle."""
        return Correction(scale=math.exp(-sum(extent_ratio(own, region)) / 2))

    def along_ray(self, log_depth: float) -> Correction:
        """To another depth, log_depth being the log of the present one over it."""
        way = self.middle_m - self._eye_m()
        if self.snapshot.camera.type == "ORTHO":
            way = self._axes()[:, 2] * self.depth_m
        return Correction(move_m=as_triple(way * math.expm1(-log_depth)))

    def _axes(self) -> F64:
        """(3, 3) the camera's right, down and forward in the world, as columns."""
        return np.array(self.snapshot.camera.world_from_camera, np.float64)[:, :3]

    def _eye_m(self) -> F64:
        pose = np.array(self.snapshot.camera.world_from_camera, np.float64)
        return np.asarray(pose[:, 3] * self.snapshot.render.unit_scale)

    def _pixels_per_metre(self) -> F64:
        """(2, 3) how far right and down the entity goes in the picture for a metre in the world."""
        camera = projection(self.snapshot.camera, self.snapshot.render, self.size_wh)
        own = self._axes().T @ (self.middle_m - self._eye_m())
        right, down, depth = own[0], own[1], self.depth_m
        if camera.orthographic:
            units = self.snapshot.render.unit_scale
            inside = np.array([[camera.fx, 0, 0], [0, camera.fy, 0]]) / units
        else:
            inside = np.array(
                [
                    [camera.fx / depth, 0.0, -camera.fx * right / depth**2],
                    [0.0, camera.fy / depth, -camera.fy * down / depth**2],
                ]
            )
        return np.asarray(inside @ self._axes().T)

    def _on_ground(
        self, jacobian: F64, shift_px: F64, in_plane_m: float
    ) -> tuple[float, float, float] | None:
        try:
            flat = np.linalg.solve(jacobian[:, :2], shift_px)
        except np.linalg.LinAlgError:
            return None
        if not np.linalg.norm(flat) <= _LONGEST * in_plane_m:
            return None
        return as_triple(np.append(flat, 0.0))


def is_cut(shape: Shape, size_wh: tuple[int, int]) -> bool:
    """Whether the picture's edge cuts a shape off, so that its centroid and extent say little."""
    x, y, w, h = shape.extent_xywh
    return x == 0 or y == 0 or x + w == size_wh[0] or y + h == size_wh[1]


def as_triple(vector: F64) -> tuple[float, float, float]:
    """The numbers of a (3,) vector for a record."""
    x, y, z = (float(v) for v in vector)
    return x, y, z
