"""The second card's private half of one case: a probe, and the reference as it sees it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, cast

import numpy as np
from msgspec.structs import replace as with_fields
from numpy.typing import NDArray

from legoworld.bench.case import CaseRefusedError, SeenCase, public_hfov_deg
from legoworld.cards import Card
from legoworld.evaluation.reconstruction.fscore import mean_f1, scores_on_rasters
from legoworld.evaluation.reconstruction.nearest import GridSurface
from legoworld.evaluation.reconstruction.points import Tolerance, picture_raster
from legoworld.evaluation.reconstruction.reference import index_labels, kept_depth
from legoworld.evaluation.reconstruction.second_card import within
from legoworld.readouts.probing import VIEW, Box, Look, box_samples, looks, mesh_triangles
from legoworld.readouts.surface import visible_surface
from legoworld.records.bench_dataset import ScoredObject
from legoworld.records.second_card import CONTEXT, NEAR, OWN
from legoworld.records.track import Motion, Probe, SecondView
from legoworld.scene.affine import cam_from_mesh
from legoworld.scene.instances import Grouping
from legoworld.scene.snapshot import SceneCamera, Snapshot
from legoworld.visibility.view import view_through

F64 = NDArray[np.float64]
#: Poses that are tried for a private view.
_TRIED: Final = 24
#: Less than this of the way to what is scored, at 1 % of the pixels, is inside of something.
_NEAR: Final = 0.2


@dataclass(frozen=True, kw_only=True)
class XCase:
    """A probe and what `records.second_card` keeps of it. private_view: no camera is there."""

    probe: Probe
    arrays: dict[str, NDArray[Any]]
    R_empty: float
    private_view: bool


def see_x(
    snapshot: Snapshot,
    grouping: Grouping,
    size_wh: tuple[int, int],
    seen_case: SeenCase,
    other: SceneCamera | None,
    secret: int,
    card: Card,
    *,
    threads: int,
) -> XCase:
    """Choose a case's probe and look at the reference through it; same secret, same bytes.

    other: the next view's camera, None in a family of one view. card: bench-x.
    """
    random = np.random.default_rng(secret)
    least, most = card.value("x.offset_px")
    offset = random.uniform(least, most, 2) * random.choice([-1.0, 1.0], 2)
    objects = [_Extent.of(snapshot, grouping, one, card) for one in seen_case.scored_objects]
    chosen = None if other is None else _view_of(snapshot, other, size_wh)
    probe = Probe(
        offset_px=(float(offset[0]), float(offset[1])),
        view=chosen,
        boxes_m=tuple((_vector(o.low - o.tau_m), _vector(o.high + o.tau_m)) for o in objects),
        spacings_m=tuple(o.spacing_m for o in objects),
    )
    if probe.view is None:
        view = _private_view(snapshot, grouping, size_wh, seen_case, probe, random, card, threads)
        probe = with_fields(probe, view=view)
    arrays: dict[str, NDArray[Any]] = {}
    for look in looks(snapshot, size_wh, seen_case.hfov_deg, probe):
        depth, instance = _draw_buffers(look, grouping, seen_case.raster_wh, threads)
        arrays |= {f"{look.name}_depth_z_m": depth, f"{look.name}_instance": instance}
    return XCase(
        probe=probe,
        arrays=arrays | _points(snapshot, grouping, seen_case.scored_objects, objects),
        R_empty=_r_empty(snapshot, grouping, size_wh, seen_case, card, threads),
        private_view=chosen is None,
    )


@dataclass(frozen=True, kw_only=True)
class _Extent:
    """The box around an object in the camera frame, and what F3D allows there."""

    low: F64
    high: F64
    tau_m: float
    spacing_m: float

    @classmethod
    def of(cls, snapshot: Snapshot, grouping: Grouping, one: ScoredObject, card: Card) -> _Extent:
        metres = snapshot.render.unit_scale
        shown = np.flatnonzero(grouping.surface_instance == one.id)
        placed = cam_from_mesh(snapshot.camera, snapshot.world_from_mesh[shown]) * metres
        corners = [
            mesh_triangles(snapshot, int(snapshot.surface_mesh[surface]), rows).reshape(-1, 3)
            for surface, rows in zip(shown.tolist(), placed, strict=True)
        ]
        points = np.concatenate(corners)
        low, high = points.min(axis=0), points.max(axis=0)
        tau = card.value("x.box_tolerance") * float(np.linalg.norm(high - low))
        return cls(low=low, high=high, tau_m=tau, spacing_m=card.value("x.spacing") * tau)

    def box(self, taus: float) -> Box:
        return Box(
            low=_vector(self.low - taus * self.tau_m),
            high=_vector(self.high + taus * self.tau_m),
            spacing_m=self.spacing_m,
        )


def _vector(values: F64) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _draw_buffers(
    look: Look, grouping: Grouping, raster_wh: tuple[int, int], threads: int
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    drawn = view_through(look.projection, look.snapshot, grouping, raster_wh, threads=threads)
    return drawn.buffers.depth_z_m, drawn.buffers.instance


def _view_of(snapshot: Snapshot, other: SceneCamera, size_wh: tuple[int, int]) -> SecondView | None:
    """Another camera of the scene as a second view; None where its field of view says not all."""
    try:
        hfov_deg = public_hfov_deg(replace(snapshot, camera=other), size_wh)
    except CaseRefusedError:
        return None
    ours, theirs = (_square(camera) for camera in (snapshot.camera, other))
    between = np.linalg.inv(ours) @ theirs
    between[:3, 3] *= snapshot.render.unit_scale
    return SecondView(cam_from_view=_motion(between), hfov_deg=hfov_deg)


def _square(camera: SceneCamera) -> F64:
    return np.vstack([np.array(camera.world_from_camera, np.float64), [0.0, 0.0, 0.0, 1.0]])


def _motion(matrix: F64) -> Motion:
    return cast("Motion", tuple(tuple(float(x) for x in row) for row in matrix))


def _private_view(
    snapshot: Snapshot,
    grouping: Grouping,
    size_wh: tuple[int, int],
    seen_case: SeenCase,
    probe: Probe,
    random: np.random.Generator,
    card: Card,
    threads: int,
) -> SecondView | None:
    """The first of some poses around what is scored that sees the same objects; None for none."""
    ids = [one.id for one in seen_case.scored_objects]
    of_scored = np.isin(seen_case.raster_instance, ids)
    pivot_m = float(np.median(seen_case.raster_depth_z_m[of_scored]))
    before = np.array([np.count_nonzero(seen_case.raster_instance == i) for i in ids])
    for pose in _poses(pivot_m, random, card):
        view = SecondView(cam_from_view=pose, hfov_deg=seen_case.hfov_deg)
        found = [
            look
            for look in looks(snapshot, size_wh, seen_case.hfov_deg, with_fields(probe, view=view))
            if look.name == VIEW
        ]
        depth, instance = _draw_buffers(found[0], grouping, seen_case.raster_wh, threads)
        after = np.array([np.count_nonzero(instance == i) for i in ids])
        near_m = float(np.percentile(depth, 1))
        if (after >= card.value("x.view_share") * before).all() and near_m > _NEAR * pivot_m:
            return view
    return None


def _poses(pivot_m: float, random: np.random.Generator, card: Card) -> Iterator[Motion]:
    """Cameras that look at a point straight ahead, from the side and a little from above."""
    least, most = (math.radians(angle) for angle in card.value("x.view_angles_deg"))
    for _ in range(_TRIED):
        yaw = float(random.uniform(least, most) * random.choice([-1.0, 1.0]))
        pitch = float(random.uniform(0.0, least))
        cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
        turned = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @ np.array(
            [[1, 0, 0], [0, cp, sp], [0, -sp, cp]]
        )
        pose = np.eye(4)
        pose[:3, :3] = turned
        pose[:3, 3] = np.array([0, 0, pivot_m]) - turned @ np.array([0, 0, pivot_m])
        yield _motion(pose)


def _points(
    snapshot: Snapshot,
    grouping: Grouping,
    scored_objects: Sequence[ScoredObject],
    objects: Sequence[_Extent],
) -> dict[str, NDArray[Any]]:
    """Samples of each object, and of what else is within reach of its box."""
    parts: list[tuple[NDArray[np.float32], int, NDArray[np.int8]]] = []
    for k, (one, extent) in enumerate(zip(scored_objects, objects, strict=True)):
        of_object = grouping.surface_instance == one.id
        own = box_samples(snapshot, [extent.box(1.0)], among=of_object)[0]
        context = box_samples(snapshot, [extent.box(3.0)], among=~of_object)[0]
        kind = np.where(within(own, context, extent.tau_m), NEAR, OWN).astype(np.int8)
        parts += [(own, k, kind), (context, k, np.full(len(context), CONTEXT, np.int8))]
    sizes = [len(points) for points, _, _ in parts]
    return {
        "points_m": np.concatenate([points for points, _, _ in parts]),
        "point_object": np.repeat(np.array([k for _, k, _ in parts], np.int32), sizes),
        "point_kind": np.concatenate([kind for _, _, kind in parts]),
    }


def _r_empty(
    snapshot: Snapshot,
    grouping: Grouping,
    size_wh: tuple[int, int],
    seen_case: SeenCase,
    card: Card,
    threads: int,
) -> float:
    """R of the reference with every scored object deleted."""
    left = ~np.isin(grouping.surface_instance, [one.id for one in seen_case.scored_objects])
    depth = np.full_like(seen_case.raster_depth_z_m, np.inf)
    if left.any():
        rest = replace(
            snapshot,
            surface_occurrence=snapshot.surface_occurrence[left],
            surface_mesh=snapshot.surface_mesh[left],
            surface_holdout=snapshot.surface_holdout[left],
            world_from_mesh=snapshot.world_from_mesh[left],
        )
        depth = visible_surface(
            rest, size_wh, seen_case.hfov_deg, own_intrinsics=False, threads=threads
        ).depth_z_m
    label = index_labels(seen_case.raster_instance, seen_case.scored_objects)
    raster = picture_raster(size_wh, seen_case.hfov_deg, seen_case.raster_wh)
    limit_m, tau = card.value("scoring.depth_limit_m"), card.value("scoring.tolerance")
    ours, theirs = (
        GridSurface(depth_z_m=z, label=label, raster=raster)
        for z in (kept_depth(seen_case.raster_depth_z_m, limit_m), depth)
    )
    tolerance = Tolerance(name="empty", relative=tau)
    return (
        mean_f1(scores_on_rasters(ours, theirs, len(seen_case.scored_objects), [tolerance])[0])
        or 0.0
    )
