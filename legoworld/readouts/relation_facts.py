"""The facts of one picture: what holds between its labelled objects, with signed margins.

Directions are those of the camera; support, containment and distance are measured in the world by
`legoworld.solids`, as the plugin measures them. Exact geometry is asked only of pairs whose boxes
are near each other: the others have the distance of their boxes as a bound.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld import extras
from legoworld.errors import InstallationError
from legoworld.readouts.relation_contacts import TOUCH_M, Floats, ObjectArrays, contacts
from legoworld.records.relations import FactObject, FactPairs, Facts
from legoworld.scene.affine import cam_from_mesh, transform_points
from legoworld.scene.instances import Instance
from legoworld.scene.snapshot import Snapshot
from legoworld.solids.hulls import facing_angles_deg
from legoworld.solids.meshes import surfaces_solid
from legoworld.visibility.layers import HiddenPixels, amodal_areas, amodal_layers, occluders
from legoworld.visibility.view import View

#: Objects of a picture whose pairs are looked at: the largest visible ones.
MOST_OBJECTS: Final = 100
_DIGITS: Final = 6


def relation_facts(
    view: View,
    instances: Sequence[Instance],
    *,
    most: int = MOST_OBJECTS,
    threads: int | None = None,
) -> Facts:
    """The facts of the labelled instances with a visible pixel, at most the `most` largest.

    InstallationError without python-fcl.
    """
    if importlib.util.find_spec("fcl") is None:
        raise InstallationError(
            "relations are measured with python-fcl, which is not installed",
            found="no module fcl",
            expected="the optional package python-fcl",
            next_step=extras.install_command("plugin"),
        )
    shown = [i for i in instances if i.category is not None and view.area_px[i.id] > 0]
    largest = sorted(shown, key=lambda i: (-int(view.area_px[i.id]), i.id))[:most]
    kept = sorted(largest, key=lambda i: i.id)
    things = _object_arrays(view, kept)
    layers = amodal_layers(
        view.surfaces, view.projection, view.size_wh, depth_scale=view.depth_scale, threads=threads
    )
    areas = amodal_areas(layers, len(view.area_px))
    return Facts(
        size_wh=view.size_wh,
        objects=_objects(view, things, areas),
        pairs=_pairs(view, things, areas, occluders(layers)),
        left_out=len(shown) - len(kept),
    )


def _object_arrays(view: View, instances: Sequence[Instance]) -> ObjectArrays:
    shot, camera = view.snapshot, view.snapshot.camera
    (cam_from_world,) = cam_from_mesh(camera, np.eye(3, 4)[None])
    cam_from_world[:, 3] *= view.depth_scale
    order = np.argsort(view.surfaces.placement_id, kind="stable")
    ids = view.surfaces.placement_id[order]
    solids, fronts = [], []
    for instance in instances:
        surfaces = order[slice(*np.searchsorted(ids, [instance.id, instance.id + 1]))].tolist()
        solids.append(surfaces_solid(shot, surfaces))
        fronts.append(_front(shot, surfaces, instance.name))
    points = np.concatenate([np.empty((0, 3)), *(solid.points for solid in solids)])
    starts = np.cumsum([0, *(len(solid.points) for solid in solids)])[:-1]
    seen = transform_points(cam_from_world, points)
    return ObjectArrays(
        instances=instances,
        solids=solids,
        fronts=np.array(fronts).reshape(-1, 3),
        cam_low=np.minimum.reduceat(seen, starts),
        cam_high=np.maximum.reduceat(seen, starts),
        low=np.minimum.reduceat(points, starts),
        high=np.maximum.reduceat(points, starts),
    )


def _front(shot: Snapshot, surfaces: Sequence[int], name: str) -> Floats:
    """(3,) the -Y axis of the labelled object's own surface; NaN where it has none."""
    for surface in surfaces:
        shown = shot.occurrence_object[shot.surface_occurrence[surface]]
        if shot.objects[shown].name == name:
            return np.asarray(-shot.world_from_mesh[surface][:, 1])
    return np.full(3, math.nan)


def _objects(view: View, arrays: ObjectArrays, areas: NDArray[np.int64]) -> tuple[FactObject, ...]:
    centre = (arrays.cam_low + arrays.cam_high) / 2
    size = arrays.high - arrays.low
    objects = []
    for n, instance in enumerate(arrays.instances):
        assert instance.category is not None
        x0, y0, x1, y1 = (int(v) for v in view.bbox_xyxy_px[instance.id])
        area = int(view.area_px[instance.id])
        objects.append(
            FactObject(
                id=instance.id,
                name=instance.name,
                category=instance.category.name,
                area_px=area,
                bbox_xywh_px=(x0, y0, x1 - x0, y1 - y0),
                visible=_round(area / areas[instance.id]),
                centre_cam_m=_vector(centre[n]),
                size_m=_vector(size[n]),
            )
        )
    return tuple(objects)


def _pairs(
    view: View, arrays: ObjectArrays, areas: NDArray[np.int64], hiding: HiddenPixels
) -> FactPairs:
    ids = np.array([i.id for i in arrays.instances], np.int64)
    a, b = np.triu_indices(len(ids), 1)
    left, above, front = _directions(view, arrays)
    middle = arrays.middle
    gap = np.maximum(arrays.low[:, None] - arrays.high[None], 0)
    apart = _norm(np.maximum(gap, gap.transpose(1, 0, 2)))
    diagonal = _norm(arrays.high - arrays.low)
    near = (diagonal[:, None] + diagonal[None]) / 2
    under, hidden = _under(arrays), _hidden(arrays, areas, hiding)
    angle = _angles(arrays)
    met = contacts(arrays, apart, near)

    def round_values(values: Floats) -> tuple[float, ...]:
        return tuple((np.round(values, _DIGITS) + 0.0).tolist())  # no -0.0

    def round_known_values(values: Floats) -> tuple[float | None, ...]:
        there = np.flatnonzero(~np.isnan(values))
        if len(there) == len(values):
            return round_values(values)
        column: list[float | None] = [None] * len(values)
        for k, value in zip(there.tolist(), round_values(values[there]), strict=True):
            column[k] = value
        return tuple(column)

    return FactPairs(
        a=tuple(ids[a].tolist()),
        b=tuple(ids[b].tolist()),
        left_m=round_values(left[a, b]),
        above_m=round_values(above[a, b]),
        front_m=round_values(front[a, b]),
        centre_m=round_values(_norm(middle[a] - middle[b])),
        apart_m=round_values(apart[a, b]),
        near_m=round_values(near[a, b]),
        surface_m=round_known_values(met.surface[a, b]),
        depth_m=round_known_values(met.depth[a, b]),
        gap_ab_m=round_known_values(met.rest_gap[a, b]),
        gap_ba_m=round_known_values(met.rest_gap[b, a]),
        inside_ab=round_known_values(met.inside[a, b]),
        inside_ba=round_known_values(met.inside[b, a]),
        within_ab=round_known_values(met.within[a, b]),
        within_ba=round_known_values(met.within[b, a]),
        under_ab_m=round_values(under[a, b]),
        under_ba_m=round_values(under[b, a]),
        angle_ab_deg=round_known_values(angle[a, b]),
        angle_ba_deg=round_known_values(angle[b, a]),
        hidden_ab=round_values(hidden[a, b]),
        hidden_ba=round_values(hidden[b, a]),
    )


def _directions(view: View, arrays: ObjectArrays) -> tuple[Floats, Floats, Floats]:
    """(n, n) margins of left of, above, in front of.

    Across the picture, extents are seen from the object's own middle depth, and the gap is taken in
    metres at the pair's mean depth; it is 0 where the boxes of visible pixels do not agree.
    """
    low, high = arrays.cam_low, arrays.cam_high
    depth = (low[:, 2] + high[:, 2]) / 2
    seen = np.where(depth > 0, depth, np.nan)[:, None]
    mean = (seen + seen.T) / 2
    if view.projection.orthographic:
        seen, mean = np.ones_like(seen), np.ones_like(mean)
    boxes = view.bbox_xyxy_px[[i.id for i in arrays.instances]].reshape(-1, 4).astype(np.float64)
    across = []
    for axis in (0, 1):
        gap = _gap(low[:, axis] / seen[:, 0], high[:, axis] / seen[:, 0]) * mean
        agrees = gap * _gap(boxes[:, axis], boxes[:, axis + 2]) > 0
        across.append(np.where(agrees, gap, 0.0))
    return across[0], across[1], _gap(low[:, 2], high[:, 2])


def _gap(low: Floats, high: Floats) -> Floats:
    """(n, n) how far interval a ends before b begins; negative if b is first, 0 if they overlap."""
    before = low[None] - high[:, None]
    return np.asarray(np.maximum(before, 0) - np.maximum(before.T, 0))


def _under(arrays: ObjectArrays) -> Floats:
    """(n, n) how far a is straight below b: the least of the gap and the overlap of their ground.

    Things in contact are a centimetre apart, so that what carries another is under it.
    """
    low, high = arrays.low, arrays.high
    shared = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    gap = low[None, :, 2] - high[:, None, 2] + TOUCH_M
    return np.asarray(np.minimum(gap, shared[..., :2].min(axis=2)))


def _hidden(arrays: ObjectArrays, areas: NDArray[np.int64], pairs: HiddenPixels) -> Floats:
    """(n, n) the share of a's silhouette at which the picture shows b."""
    n = len(arrays.instances)
    index = np.full(len(areas) + 1, -1)  # the last entry is for holdouts
    index[[i.id for i in arrays.instances]] = np.arange(n)
    hiding = np.where(pairs.hiding < 0, len(areas), pairs.hiding)
    known = (index[pairs.hidden] >= 0) & (index[hiding] >= 0)
    hidden = np.zeros((n, n))
    shares = pairs.count[known] / areas[pairs.hidden[known]]
    hidden[index[pairs.hidden[known]], index[hiding[known]]] = shares
    return hidden


def _angles(arrays: ObjectArrays) -> Floats:
    """(n, n) angles between a's front and the way to b; NaN where it has none."""
    middle = arrays.middle
    return facing_angles_deg(arrays.fronts[:, None], middle[None] - middle[:, None])


def _norm(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def _round(value: float) -> float:
    return round(float(value), _DIGITS) + 0.0  # no -0.0


def _vector(values: Floats) -> tuple[float, float, float]:
    x, y, z = (_round(v) for v in values)
    return x, y, z
