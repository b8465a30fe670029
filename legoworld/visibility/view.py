"""What the camera of a snapshot sees: instance and depth buffers of one picture size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD, NO_INSTANCE
from legoworld.errors import ShapeError
from legoworld.scene.affine import cam_from_mesh
from legoworld.scene.instances import Grouping
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.amodal import Amodal
from legoworld.visibility.camera import projection
from legoworld.visibility.distorted import LensMap
from legoworld.visibility.kernel import HOLDOUT, Buffers, Cutouts, Surfaces, coverage, render
from legoworld.visibility.layers import amodal_layers
from legoworld.visibility.normals import Normals, Variant, render_normals
from legoworld.visibility.projection import Projection
from legoworld.visibility.runs import instance_extents

#: Why an instance has no pixel, by the kernel's coverage code of its best placement.
UNSEEN_REASONS: Final = {
    0: "no_area",
    1: "behind_camera",
    2: "beyond_clip_end",
    3: "outside_view",
    4: "sub_pixel",
    5: "hidden",
}


@dataclass(frozen=True, kw_only=True)
class View:
    """Buffers of one scene at one size, and what they were made with.

    snapshot: the scene; depth_scale: metres of a scene unit.
    area_px: (N,) int64, visible pixels of each instance of the grouping.
    bbox_xyxy_px: (N, 4) int64, half-open pixel extents of each; zeros where area is 0.
    lens: what distorts it, None for a pinhole; drawn_normals: where they were asked for.
    """

    snapshot: Snapshot
    size_wh: tuple[int, int]
    projection: Projection
    surfaces: Surfaces
    depth_scale: float
    buffers: Buffers
    area_px: NDArray[np.int64]
    bbox_xyxy_px: NDArray[np.int64]
    lens: LensMap | None = None
    drawn_normals: Normals | None = None

    @property
    def drawn_projection(self) -> tuple[Projection, tuple[int, int]]:
        """The projection and size that the surfaces were drawn with: of the lens, if any."""
        if self.lens is None:
            return self.projection, self.size_wh
        return self.lens.projection, self.lens.size_wh

    def amodal(self, *, threads: int | None = None) -> Amodal:
        """Every instance of the same picture as if it were alone, by another drawing.

        LegoWorldError where the masks are too large together (`layers.MAX_ENTRIES`).
        """
        layers = amodal_layers(
            self.surfaces,
            self.projection,
            self.size_wh,
            depth_scale=self.depth_scale,
            threads=threads,
        )
        return Amodal(
            layers=layers,
            surfaces=self.surfaces,
            projection=self.projection,
            visible_px=self.area_px,
        )

    def normals(self, variant: Variant = "geometric", *, threads: int | None = None) -> Normals:
        """Normals of the same picture; by another drawing, where it was drawn without them.

        They do not depend on the grouping: where surfaces tie in stored depth, the first placement
        is taken, whatever instance it belongs to. ShapeError for shading normals of a snapshot that
        was read without corner normals.
        """
        if self.drawn_normals is not None and self.drawn_normals.variant == variant:
            return self.drawn_normals
        corners = self.snapshot.corner_normal if variant == "shading" else None
        if variant == "shading" and corners is None:
            raise ShapeError("the snapshot has no corner normals")
        made = render_normals(
            replace(self.surfaces, placement_id=_placements(self.surfaces)),
            *self.drawn_projection,
            corner_normals=corners,
            depth_scale=self.depth_scale,
            threads=threads,
        )
        if self.lens is None:
            return made
        return replace(made, normal_cam=self.lens.look_up(made.normal_cam, np.nan))


def view(
    snapshot: Snapshot,
    grouping: Grouping,
    size_wh: tuple[int, int],
    *,
    exact: bool = True,
    normals: Variant | None = None,
    threads: int | None = None,
) -> View:
    """`view_through` the snapshot's own camera."""
    camera = projection(snapshot.camera, snapshot.render, size_wh)
    return view_through(
        camera, snapshot, grouping, size_wh, exact=exact, normals=normals, threads=threads
    )


def view_through(
    camera: Projection,
    snapshot: Snapshot,
    grouping: Grouping,
    size_wh: tuple[int, int],
    *,
    exact: bool = True,
    normals: Variant | None = None,
    threads: int | None = None,
    lens: LensMap | None = None,
) -> View:
    """Render a snapshot's instances from its camera's pose with a given projection.

    camera: in pixels of `size_wh` and scene units. exact: of surfaces at equal stored depth the
    lower instance is shown; otherwise the first placement may be. normals: drawn along where both
    rules are one, or the first is not needed, and nothing distorts the picture. lens: the map of
    what distorts it, if anything.
    """
    surfaces = _surfaces(snapshot, grouping.surface_instance)
    scale, drawn = snapshot.render.unit_scale, None
    in_order = bool((np.diff(grouping.surface_instance) >= 0).all())
    if normals is not None and lens is None and (in_order or not exact):
        drawn = render_normals(
            surfaces if in_order else replace(surfaces, placement_id=_placements(surfaces)),
            camera,
            size_wh,
            corner_normals=snapshot.corner_normal if normals == "shading" else None,
            depth_scale=scale,
            threads=threads,
        )
        buffers = drawn.buffers
        if not in_order:
            instance = np.append(grouping.surface_instance, NO_INSTANCE)[buffers.instance]
            buffers = replace(buffers, instance=instance.astype(np.int32))
    else:
        buffers = render(
            surfaces,
            lens.projection if lens else camera,
            lens.size_wh if lens else size_wh,
            depth_scale=scale,
            threads=threads,
        )
        if lens is not None:
            buffers = Buffers(
                instance=lens.look_up(buffers.instance, NO_INSTANCE),
                depth_z_m=lens.look_up(buffers.depth_z_m, np.inf),
            )
    area, extents = instance_extents(buffers.instance, len(grouping.instances))
    return View(
        snapshot=snapshot,
        size_wh=size_wh,
        projection=camera,
        surfaces=surfaces,
        depth_scale=scale,
        buffers=buffers,
        area_px=area,
        bbox_xyxy_px=extents,
        lens=lens,
        drawn_normals=drawn,
    )


def _placements(surfaces: Surfaces) -> NDArray[np.int32]:
    """A number for each placement in place of its instance; holdouts stay holdouts."""
    ids = surfaces.placement_id
    return np.where(ids == HOLDOUT, HOLDOUT, np.arange(len(ids))).astype(np.int32)


def surfaces_through(
    camera: Projection,
    snapshot: Snapshot,
    size_wh: tuple[int, int],
    *,
    threads: int | None = None,
) -> Buffers:
    """Surface index and depth at each pixel, without regard to labels."""
    numbers = np.arange(len(snapshot.surface_mesh), dtype=np.int32)
    return render(
        _surfaces(snapshot, numbers),
        camera,
        size_wh,
        depth_scale=snapshot.render.unit_scale,
        threads=threads,
    )


def unseen_reasons(
    snapshot: Snapshot,
    grouping: Grouping,
    view: View,
    *,
    among: Sequence[int] | None = None,
    threads: int | None = None,
) -> dict[int, str]:
    """The reason, of `UNSEEN_REASONS`, for each instance without a visible pixel, by instance id.

    among: instance ids, None for all.
    """
    is_asked = view.area_px == 0
    if among is not None:
        is_asked &= np.isin(np.arange(len(is_asked)), np.asarray(among, np.int64))
    unseen = np.flatnonzero(is_asked)
    if not len(unseen):
        return {}
    asked = np.flatnonzero(is_asked[grouping.surface_instance])
    codes = coverage(
        _only(view.surfaces, asked),
        *view.drawn_projection,
        threads=threads,
    )
    best = np.zeros(len(grouping.instances), np.uint8)
    np.maximum.at(best, grouping.surface_instance[asked], codes)
    held_out = np.ones(len(grouping.instances), bool)
    held_out[grouping.surface_instance[snapshot.surface_holdout == 0]] = False
    return {int(i): "holdout" if held_out[i] else UNSEEN_REASONS[int(best[i])] for i in unseen}


def _only(surfaces: Surfaces, placements: NDArray[np.intp]) -> Surfaces:
    """Some placements and the meshes they show, without cut-outs, which coverage ignores.

    What is unseen is mostly little, and what is seen was checked when it was drawn.
    """
    meshes, number = np.unique(surfaces.placement_mesh[placements], return_inverse=True)

    def take_meshes(values: NDArray[Any], starts: NDArray[np.int64]) -> tuple[NDArray[Any], Any]:
        parts = [values[starts[m] : starts[m + 1]] for m in meshes.tolist()]
        ends = np.cumsum([0, *map(len, parts)], dtype=np.int64)
        return np.concatenate([values[:0], *parts]), ends

    vertices, vertex_start = take_meshes(surfaces.vertices, surfaces.vertex_start)
    triangles, triangle_start = take_meshes(surfaces.triangles, surfaces.triangle_start)
    return Surfaces(
        vertices=vertices,
        triangles=triangles,
        vertex_start=vertex_start,
        triangle_start=triangle_start,
        placement_mesh=number.astype(np.int32),
        cam_from_mesh=surfaces.cam_from_mesh[placements],
        placement_id=surfaces.placement_id[placements],
        cutouts=None,
    )


def _surfaces(snapshot: Snapshot, surface_instance: NDArray[np.int32]) -> Surfaces:
    cutouts = None
    if snapshot.cutouts:
        cutouts = Cutouts(
            triangle_cutout=snapshot.triangle_cutout,
            corner_uv=snapshot.corner_uv,
            alphas=snapshot.cutout_alphas,
            wrap=tuple(c.wrap for c in snapshot.cutouts),
            interpolation=tuple(c.interpolation for c in snapshot.cutouts),
            sides=tuple(c.sides for c in snapshot.cutouts),
            corner_alpha=snapshot.corner_alpha if len(snapshot.corner_alpha) else None,
            threshold=ALPHA_THRESHOLD,
        )
    return Surfaces(
        vertices=snapshot.vertices,
        triangles=snapshot.triangles,
        vertex_start=snapshot.vertex_start,
        triangle_start=snapshot.triangle_start,
        placement_mesh=snapshot.surface_mesh,
        cam_from_mesh=cam_from_mesh(snapshot.camera, snapshot.world_from_mesh),
        placement_id=np.where(snapshot.surface_holdout == 1, HOLDOUT, surface_instance).astype(
            np.int32
        ),
        cutouts=cutouts,
    )
