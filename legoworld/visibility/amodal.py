"""Every instance of a view as if it were alone: silhouettes, fractions, occluders, layer order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.affine import transform_points
from legoworld.visibility.kernel import render
from legoworld.visibility.layers import (
    AmodalLayers,
    HiddenPixels,
    amodal_areas,
    direct_occluders,
    occluders,
)
from legoworld.visibility.projection import Projection
from legoworld.visibility.runs import ColumnRuns
from legoworld.visibility.surfaces import Surfaces

#: Pixels of the largest canvas that an instance is drawn on to find its whole silhouette.
MOST_WHOLE_PX: Final = 2**26
#: The longest side of it, and its farthest distance from the frame, pixels.
MOST_SIDE_PX: Final = 2**17
#: Sides of the pieces of a canvas, pixels.
_PIECE_PX: Final = 2048

Unknown = Literal["crosses_near_plane", "canvas_too_large"]


@dataclass(frozen=True, kw_only=True)
class Silhouette:
    """One instance: |A| pixels in the frame, |V| of them visible, `whole_px` on an infinite plane.

    whole_px: None where the instance crosses the near plane (its silhouette has no bounds), or its
    canvas is larger than MOST_WHOLE_PX or MOST_SIDE_PX; unknown: which of them. A fraction is None
    where its denominator is 0 or unknown.
    """

    in_frame_px: int
    visible_px: int
    whole_px: int | None
    unknown: Unknown | None

    @property
    def visible_of_in_frame(self) -> float | None:
        """|V| / |A|: 1 less the share that others hide."""
        return self.visible_px / self.in_frame_px if self.in_frame_px else None

    @property
    def in_frame_of_whole(self) -> float | None:
        """|A| / whole: 1 less the share that the frame cuts off."""
        return self.in_frame_px / self.whole_px if self.whole_px else None

    @property
    def visible_of_whole(self) -> float | None:
        """|V| / whole: the product of the two."""
        return self.visible_px / self.whole_px if self.whole_px else None


@dataclass(frozen=True, kw_only=True)
class LayerOrder:
    """Who is in front, by direct occluders. Nothing is forced into an order: cycles are parts.

    part: (N,) the strongly connected part of each instance; layer: (N,) 0 where nothing is in front
    of the part, else one more than the farthest layer of the parts directly in front of it.
    """

    part: NDArray[np.int64]
    layer: NDArray[np.int64]

    def cycle(self, instance_id: int) -> tuple[int, ...]:
        """The instances that hide each other in a cycle with this one, itself included; or none."""
        members = np.flatnonzero(self.part == self.part[instance_id])
        return tuple(members.tolist()) if len(members) > 1 else ()


@dataclass(frozen=True, kw_only=True)
class Amodal:
    """The amodal layers of a view of N instances. visible_px: (N,) visible pixels of each."""

    layers: AmodalLayers
    surfaces: Surfaces
    projection: Projection
    visible_px: NDArray[np.int64]

    @cached_property
    def in_frame_px(self) -> NDArray[np.int64]:
        """(N,) pixels of each amodal mask."""
        return amodal_areas(self.layers, len(self.visible_px))

    @cached_property
    def masks(self) -> ColumnRuns:
        """Amodal masks as COCO run lengths."""
        return ColumnRuns(self.layers, len(self.visible_px))

    @cached_property
    def occluders(self) -> HiddenPixels:
        """Pixels of each amodal mask, by the instance that the picture shows there."""
        return occluders(self.layers)

    @cached_property
    def direct_occluders(self) -> HiddenPixels:
        """Pixels of each amodal mask, by the nearest instance in front."""
        return direct_occluders(self.layers)

    @cached_property
    def order(self) -> LayerOrder:
        """The layers of all instances."""
        return layer_order(self.direct_occluders, len(self.visible_px))

    def silhouettes(self, ids: Sequence[int], threads: int | None = None) -> list[Silhouette]:
        """The silhouettes of these instances; each that leaves the frame is drawn again."""
        made = []
        for i in ids:
            outside = self._outside(i, threads)
            in_frame = int(self.in_frame_px[i])
            made.append(
                Silhouette(
                    in_frame_px=in_frame,
                    visible_px=int(self.visible_px[i]),
                    whole_px=in_frame + outside if isinstance(outside, int) else None,
                    unknown=None if isinstance(outside, int) else outside,
                )
            )
        return made

    def _outside(self, instance_id: int, threads: int | None) -> int | Unknown:
        """Pixels of a silhouette outside of the frame."""
        own = np.flatnonzero(self.surfaces.placement_id == instance_id)
        camera, (width, height) = self.projection, self.layers.size_wh
        corners = [_corners(self.surfaces, k, camera.z_near) for k in own.tolist()]
        points = np.concatenate([np.empty((0, 3)), *corners])
        if not len(points):
            return 0
        if points[:, 2].min() < camera.z_near:
            return "crosses_near_plane"
        scale = 1 if camera.orthographic else 1 / points[:, 2:]
        uv = (camera.cx, camera.cy) + np.array([camera.fx, camera.fy]) * points[:, :2] * scale
        low, high = np.floor(uv.min(axis=0)), np.ceil(uv.max(axis=0))
        if (low >= 0).all() and (high <= (width, height)).all():
            return 0
        sides = high - low
        if sides.prod() > MOST_WHOLE_PX or max(*sides, *np.abs(low)) > MOST_SIDE_PX:
            return "canvas_too_large"
        (x0, y0), (x1, y1) = low.astype(int).tolist(), high.astype(int).tolist()
        alone = replace(
            self.surfaces,
            placement_mesh=self.surfaces.placement_mesh[own],
            cam_from_mesh=self.surfaces.cam_from_mesh[own],
            placement_id=self.surfaces.placement_id[own],
        )
        outside = 0
        for y, x in product(range(y0, y1, _PIECE_PX), range(x0, x1, _PIECE_PX)):
            size_wh = min(x1 - x, _PIECE_PX), min(y1 - y, _PIECE_PX)
            moved = replace(camera, cx=camera.cx - x, cy=camera.cy - y)
            shown = render(alone, moved, size_wh, threads=threads).instance >= 0
            shown[max(-y, 0) : max(height - y, 0), max(-x, 0) : max(width - x, 0)] = False
            outside += int(np.count_nonzero(shown))
        return outside


def _corners(surfaces: Surfaces, placement: int, z_near: float) -> NDArray[np.float64]:
    """(n, 3) camera coordinates of a placement's vertices.

    Where one is nearer than z_near, of its triangles' corners alone: other vertices show nothing.
    """
    mesh = surfaces.placement_mesh[placement]
    start, end = surfaces.vertex_start[mesh : mesh + 2]
    vertices = surfaces.vertices[start:end].astype(np.float64)
    points = transform_points(surfaces.cam_from_mesh[placement], vertices)
    if len(points) and points[:, 2].min() < z_near:
        first, last = surfaces.triangle_start[mesh : mesh + 2]
        points = points[surfaces.triangles[first:last].ravel()]
    return points


def layer_order(direct: HiddenPixels, n_instances: int) -> LayerOrder:
    """Strongly connected parts of the graph of direct occluders, and the layer of each."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    among = direct.hiding >= 0
    hidden, hiding = direct.hidden[among], direct.hiding[among]
    graph = coo_array((np.ones(len(hidden)), (hidden, hiding)), (n_instances, n_instances))
    n_parts, part = connected_components(graph.tocsr(), directed=True, connection="strong")
    between = part[hidden] != part[hiding]
    behind, front = part[hidden[between]], part[hiding[between]]
    before, layer = None, np.zeros(n_parts, np.int64)
    while before is None or not np.array_equal(before, layer):  # ends: the parts have no cycle
        before = layer.copy()
        np.maximum.at(layer, behind, before[front] + 1)
    return LayerOrder(part=part.astype(np.int64), layer=layer[part])
