"""Reading hair and points as Cycles' scene synchronisation does (blender/curves.cpp)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import NonFiniteGeometryError
from legoworld.scene.affine import inverse, length, transform_points
from legoworld.scene.hair.strands import Strands, usable
from legoworld.scene.snapshot import LARGEST_COORDINATE

if TYPE_CHECKING:
    import bpy

#: Radii Cycles takes where there is no attribute of that name.
_STRAND_RADIUS: Final = 0.005
_POINT_RADIUS: Final = 0.01
_POLY: Final = 1  # Blender's number for a curve of straight pieces


@dataclass(frozen=True, kw_only=True)
class HairSystem:
    """The strands of one particle system, in its object's frame, and their material's slot."""

    strands: Strands
    slot: int


def hair_systems(holder: bpy.types.Object) -> list[Any]:
    """The particle systems of an evaluated object that a render draws as strands."""
    if holder.mode in ("PARTICLE_EDIT", "EDIT"):
        return []
    systems = [
        modifier.particle_system
        for modifier in holder.modifiers
        if modifier.type == "PARTICLE_SYSTEM" and modifier.show_render
    ]
    return [s for s in systems if s.settings.type == "HAIR" and s.settings.render_type == "PATH"]


def particle_hair(
    holder: bpy.types.Object, system: bpy.types.ParticleSystem, elsewhere: bpy.types.Object
) -> HairSystem:
    """The strands of a particle system. Raises NonFiniteGeometryError.

    Children, where there are any, are drawn in their parents' place. elsewhere: any object that
    stands somewhere else.
    """
    settings = system.settings
    steps = (1 << settings.render_step) + 1
    if settings.kink == "SPIRAL":
        steps += settings.kink_extra_steps
    n_parents, n_children = len(system.particles), len(system.child_particles)
    first = n_parents if settings.child_type != "NONE" and n_children else 0
    n_strands = n_parents + n_children - first
    world = np.array(
        [
            system.co_hair(object=holder, particle_no=strand, step=step)[:]
            for strand in range(first, n_parents + n_children)
            for step in range(steps)
        ],
        np.float64,
    ).reshape(n_strands, steps, 3)
    _keep_last_key(world, system, first, elsewhere)
    points = _in_own_frame(holder, world)
    _refuse_broken(holder, points)
    return HairSystem(
        strands=usable(
            points.reshape(-1, 3),
            _radii(settings, points).reshape(-1),
            np.arange(n_strands + 1, dtype=np.int64) * steps,
        ),
        slot=max(0, settings.material - 1),
    )


def curve_strands(holder: bpy.types.Object) -> tuple[Strands, bool]:
    """The strands of a hair curves object, and whether they are straight pieces.

    Raises NonFiniteGeometryError.
    """
    curves = holder.data
    points = _positions(curves)
    _refuse_broken(holder, points)
    start = np.empty(len(curves.curves) + 1, np.int32)
    if len(curves.curves):
        curves.curve_offset_data.foreach_get("value", start)
    else:
        start[:] = 0
    radius = _radius(curves, start, _STRAND_RADIUS)
    kinds = curves.attributes.get("curve_type")
    straight = kinds is not None and len(kinds.data) > 0 and kinds.data[0].value == _POLY
    return usable(points, radius, start.astype(np.int64)), straight


def cloud_points(holder: bpy.types.Object) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(P, 3) points and (P,) radii of a point cloud object. Raises NonFiniteGeometryError."""
    points = _positions(holder.data)
    _refuse_broken(holder, points)
    start = np.arange(len(points) + 1, dtype=np.int32)
    return points, np.abs(_radius(holder.data, start, _POINT_RADIUS))


def _keep_last_key(
    world: NDArray[np.float64],
    system: bpy.types.ParticleSystem,
    first: int,
    elsewhere: bpy.types.Object,
) -> None:
    """Where a strand has fewer keys than the others, its last one counts for the rest.

    For a key that is not there Blender answers (0, 0, 0), whatever object it is asked for; a key
    that lies there is not there for an object that stands elsewhere.
    """
    for strand, step in np.argwhere((world == 0.0).all(axis=2)).tolist():
        again = system.co_hair(object=elsewhere, particle_no=first + strand, step=step)
        if step and not any(again):
            world[strand, step] = world[strand, step - 1]


def _in_own_frame(holder: bpy.types.Object, world: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix = np.array(holder.matrix_world, np.float64)
    try:
        back = np.array(inverse(matrix[:3, :3].tolist()), np.float64)
    except ZeroDivisionError:
        return np.zeros_like(world)
    return transform_points(np.c_[back, np.zeros(3)], world - matrix[:3, 3])


def _radii(
    settings: bpy.types.ParticleSettings, points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(C, S) radius at each key, by how far along its strand it is (Cycles' shaperadius)."""
    steps = length(points[:, 1:] - points[:, :-1])
    along = np.concatenate([np.zeros((len(points), 1)), np.cumsum(steps, axis=1)], axis=1)
    total = along[:, -1:]
    left = 1.0 - np.divide(along, total, out=np.zeros_like(along), where=total > 0)
    if settings.shape != 0.0:
        power = (
            1.0 + settings.shape if settings.shape < 0.0 else 1.0 / max(1.0 - settings.shape, 1e-30)
        )
        left = np.array([math.pow(max(x, 0.0), power) for x in left.ravel().tolist()]).reshape(
            left.shape
        )
    half = settings.radius_scale * 0.5
    root, tip = half * settings.root_radius, half * settings.tip_radius
    radius = left * (root - tip) + tip
    if settings.use_close_tip:
        radius[:, -1] = 0.0
    return np.asarray(radius)


def _positions(data: bpy.types.Curves | bpy.types.PointCloud) -> NDArray[np.float64]:
    points = np.zeros((len(data.points), 3), np.float32)
    if len(points):
        data.attributes["position"].data.foreach_get("vector", points.ravel())
    return points.astype(np.float64)


def _radius(
    data: bpy.types.Curves | bpy.types.PointCloud, start: NDArray[np.int32], otherwise: float
) -> NDArray[np.float64]:
    """(P,) radius of each point; an attribute per curve counts for all points of the curve."""
    attribute = data.attributes.get("radius")
    n_points = len(data.points)
    if attribute is None or attribute.data_type != "FLOAT":
        return np.full(n_points, otherwise)
    radius = np.empty(len(attribute.data), np.float32)
    attribute.data.foreach_get("value", radius)
    if attribute.domain != "POINT":
        radius = np.repeat(radius, np.diff(start))
    return radius.astype(np.float64)


def _refuse_broken(holder: bpy.types.Object, points: NDArray[np.float64]) -> None:
    broken = ~(np.abs(points) <= LARGEST_COORDINATE).all(axis=-1)
    if broken.any():
        raise NonFiniteGeometryError(
            f"object {holder.original.name!r} has broken hair or points",
            found=f"{int(broken.sum())} of {broken.size} points hold NaN, infinity or more than "
            f"{LARGEST_COORDINATE:g}",
            expected="finite coordinates",
            next_step="remove those points, or what makes them",
        )
