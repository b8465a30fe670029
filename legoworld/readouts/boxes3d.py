"""Boxes in space around instances: all of their surfaces, hidden and cut-off parts included.

In the camera frame (x right, y down, z forward), metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.readouts.exports import select_exported
from legoworld.readouts.family import Export
from legoworld.records.predictions import Corners, Point, Prediction
from legoworld.scene.affine import cross, transform_points, unit
from legoworld.scene.instances import Instance
from legoworld.tables.table import Number, Table, table
from legoworld.visibility.amodal import Silhouette
from legoworld.visibility.cuboids import cuboid_corners, extent_px, lines_px
from legoworld.visibility.planar_hull import EQUAL, smallest_rectangle
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import Surfaces
from legoworld.visibility.view import View

Floats = NDArray[np.float64]
#: gravity: upright, turned about the vertical so that its footprint is smallest; object: along the
#: axes of the instance's first surface; world: along the scene's axes.
Kind = Literal["gravity", "object", "world"]
KINDS: Final[tuple[Kind, ...]] = ("gravity", "object", "world")
#: What a card says is read.
BOXES_3D: Final = "boxes_3d"

#: Decimals of exported metres and rotations: what is beyond them differs between compilers.
_PLACES: Final = 9


@dataclass(frozen=True, kw_only=True)
class Box3d:
    """A box in the camera frame. Its own axes: x length, y height (downwards), z width.

    center_m: (3,); axes: (3, 3), the box's axes as columns, right-handed; size_m: (3,) length,
    height, width; the length is at least the width. silhouette: of the instance.
    """

    instance_id: int
    center_m: Floats
    axes: Floats
    size_m: Floats
    silhouette: Silhouette

    @property
    def corners_m(self) -> Floats:
        """(8, 3) in Omni3D's order."""
        return cuboid_corners(self.center_m, self.axes, self.size_m)

    @property
    def truncation(self) -> float | None:
        """Share of the whole silhouette outside the picture; None where it has no bounds."""
        inside = self.silhouette.in_frame_of_whole
        return None if inside is None else 1 - inside

    @property
    def visibility(self) -> float | None:
        """Share of the silhouette inside the picture that nothing hides."""
        return self.silhouette.visible_of_in_frame


def fit_boxes(
    view: View, ids: Sequence[int], kind: Kind = "gravity", *, threads: int | None = None
) -> list[Box3d]:
    """The boxes of instances, in the order of the ids."""
    if not ids:
        return []
    points = _Points(view.surfaces, view.depth_scale)
    whole = view.amodal(threads=threads).silhouettes(ids, threads)
    return [
        _fit_box(i, points.of(i), _frame(view, points, i, kind), of_whole, kind)
        for i, of_whole in zip(ids, whole, strict=True)
    ]


class _Points:
    """The vertices of instances in the camera frame, each mesh's taken once."""

    def __init__(self, surfaces: Surfaces, scale: float) -> None:
        self._surfaces, self._scale = surfaces, scale
        order = np.argsort(surfaces.placement_id, kind="stable")
        self._order, self._sorted = order, surfaces.placement_id[order]
        self._meshes: dict[int, Floats] = {}

    def placements(self, instance_id: int) -> list[int]:
        """The placements of an instance, ascending."""
        ends = np.searchsorted(self._sorted, [instance_id, instance_id + 1])
        return [int(k) for k in self._order[ends[0] : ends[1]]]

    def of(self, instance_id: int) -> Floats:
        """(n, 3) metres; at least one."""
        parts = [
            transform_points(self._surfaces.cam_from_mesh[k], self._mesh(k))
            for k in self.placements(instance_id)
        ]
        return np.concatenate(parts) * self._scale

    def first_axes(self, instance_id: int) -> Floats:
        """(3, 3) columns of the first placement's transform."""
        first = self.placements(instance_id)[0]
        return np.array(self._surfaces.cam_from_mesh[first, :, :3], np.float64)

    def _mesh(self, placement: int) -> Floats:
        mesh = int(self._surfaces.placement_mesh[placement])
        if mesh not in self._meshes:
            of = self._surfaces
            vertices = of.vertices[of.vertex_start[mesh] : of.vertex_start[mesh + 1]]
            used = np.zeros(len(vertices), bool)
            used[of.triangles[of.triangle_start[mesh] : of.triangle_start[mesh + 1]].ravel()] = True
            self._meshes[mesh] = vertices[used].astype(np.float64)
        return self._meshes[mesh]


def _frame(view: View, points: _Points, instance_id: int, kind: Kind) -> Floats:
    """(3, 3) the rows of a frame to fit in: two axes around the vertical one, which is the second.

    The vertical one points down; of `object`, it is the object's axis nearest to that.
    """
    world_from_cam = view.snapshot.camera.world_from_camera
    down = -np.array(world_from_cam[2][:3], np.float64)
    if kind == "object":
        axes = orthonormal(points.first_axes(instance_id))
        along = axes[:, 0] * down[0] + axes[:, 1] * down[1] + axes[:, 2] * down[2]
        upright = int(np.abs(along).argmax())
        vertical = axes[upright] * (1.0 if along[upright] >= 0 else -1.0)
        first = axes[(upright + 1) % 3]
    elif kind == "world":
        first, vertical = np.array(world_from_cam[0][:3], np.float64), down
    else:
        right, forward = np.eye(3)[0], np.eye(3)[2]
        level = right - down * down[0]
        first, vertical = level if np.abs(level).max() > 1e-6 else forward - down * down[2], down
    first = unit(first)
    return np.stack([first, vertical, cross(first, vertical)])


def orthonormal(columns: Floats) -> Floats:
    """(3, 3) rows of a rotation: the first column, what is left of the second, and their product.

    Shear and mirroring are gone; a column without a length is replaced by any direction.
    """
    given = [unit(column) for column in columns.T]
    spare = [*given[1:], *np.eye(3)]
    first = next(v for v in (given[0], *spare) if np.any(v))
    for vector in spare:
        left = vector - first * float(np.sum(vector * first))
        if np.abs(left).max() > 1e-6:
            second = unit(left)
            return np.stack([first, second, cross(first, second)])
    raise AssertionError("three axes span the space")


def _fit_box(
    instance_id: int, points: Floats, frame: Floats, silhouette: Silhouette, kind: Kind
) -> Box3d:
    if kind == "gravity":
        first, down, third = frame
        cos, sin = smallest_rectangle(np.stack([_along(points, first), _along(points, third)], 1))
        first = unit(first * cos + third * sin)
        frame = np.stack([first, down, cross(first, down)])
    spans = [_along(points, axis) for axis in frame]
    low, high = (np.array([end(s) for s in spans]) for end in (np.min, np.max))
    size, middle = high - low, (low + high) / 2
    center = frame[0] * middle[0] + frame[1] * middle[1] + frame[2] * middle[2]
    length, down, width = frame
    if size[0] < size[2] * (1 - EQUAL):
        length, size = width, size[[2, 1, 0]]
    if length[0] < 0 or (length[0] == 0 and length[2] < 0):
        length = -length
    axes = np.stack([length, down, cross(length, down)], axis=1)
    return Box3d(
        instance_id=instance_id, center_m=center, axes=axes, size_m=size, silhouette=silhouette
    )


def _along(points: Floats, axis: Floats) -> Floats:
    x, y, z = axis.tolist()
    return np.asarray(points[:, 0] * x + points[:, 1] * y + points[:, 2] * z)


def box3d_exports(
    image_id: int, instances: Sequence[Instance], view: View, *, threads: int | None = None
) -> list[Export]:
    """Results in Omni3D's words, in canonical order: category id, then the corners' numbers."""
    exported = select_exported(instances, view)
    boxes = fit_boxes(view, [i.id for i in exported], threads=threads)
    made = [
        (_prediction(image_id, instance, box, view), instance)
        for instance, box in zip(exported, boxes, strict=True)
    ]
    return sorted(made, key=lambda one: (one[0].category_id, one[0].corners))


def box3d_table(instances: Sequence[Instance], view: View, *, threads: int | None = None) -> Table:
    """The box of each exported instance: its size, depth and shares."""
    exported = select_exported(instances, view)
    boxes = fit_boxes(view, [i.id for i in exported], threads=threads)
    names = "length m", "height m", "width m", "depth m", "truncation", "visibility"
    return table(
        ("id", "instance", *names),
        [
            (
                box.instance_id,
                instance.name,
                *(Number(value=float(v)) for v in (*box.size_m, box.center_m[2])),
                *(Number(value=v) for v in (box.truncation, box.visibility)),
            )
            for instance, box in zip(exported, boxes, strict=True)
        ],
        title="Boxes in space",
    )


def _prediction(image_id: int, instance: Instance, box: Box3d, view: View) -> Prediction:
    assert instance.category is not None
    length, height, width = box.size_m
    corners: Corners = tuple(map(_round_point, box.corners_m))  # type: ignore[assignment]
    x, y, w, h = box_extent_px(box, view)
    cut, seen = box.truncation, box.visibility
    return Prediction(
        image_id=image_id,
        category_id=instance.category.id,
        score=EQUAL_CONFIDENCE,
        bbox=(round(x, 3), round(y, 3), round(w, 3), round(h, 3)),
        corners=corners,
        center_cam=_round_point(box.center_m),
        dimensions=_round_point((width, height, length)),
        r_cam=tuple(map(_round_point, box.axes)),  # type: ignore[arg-type]
        depth=_round_point(box.center_m)[2],
        truncation=None if cut is None else round(cut, _PLACES),
        visibility=None if seen is None else round(seen, _PLACES),
    )


def _round_point(values: Floats | tuple[float, float, float]) -> Point:
    x, y, z = (round(float(v), _PLACES) + 0.0 for v in values)
    return x, y, z


def box_lines_px(box: Box3d, view: View) -> list[list[float]]:
    """The edges of a box as this view's camera sees them."""
    corners, camera = box.corners_m, view.projection
    scale = 1.0
    if camera.orthographic:
        corners, scale = corners.copy(), view.depth_scale
        corners[:, 2] = 1
    return lines_px(corners, intrinsics_matrix(camera, scale))


def box_extent_px(box: Box3d, view: View) -> list[float]:
    """x, y, width, height of a box's edges inside the picture."""
    return extent_px(box_lines_px(box, view), view.size_wh)


def intrinsics_matrix(camera: Projection, scale: float = 1.0) -> list[list[float]]:
    """K of a projection; scale: metres of a scene unit, for an orthographic one."""
    fx, fy = camera.fx / scale, camera.fy / scale
    return [[fx, 0.0, camera.cx], [0.0, fy, camera.cy], [0.0, 0.0, 1.0]]
