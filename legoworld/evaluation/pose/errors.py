"""BOP's three pose errors (Hodan et al., ECCV 2018 and BOP Challenge 2020). Millimetres, pixels.

A pose is (3, 4) cam_from_model. A pixel's centre is at integer coordinates, as in BOP's files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.exports.bop import visible_bop19
from legoworld.scene.affine import transform_points
from legoworld.visibility.kernel import render
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import Surfaces

Floats = NDArray[np.float64]

#: Share of the diameter that the farthest point moves between two steps of a continuous symmetry.
_SYMMETRY_STEP: Final = 0.01


@dataclass(frozen=True, kw_only=True)
class Model:
    """A triangle mesh in its own frame. symmetries: (S, 3, 4), the first the identity."""

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    diameter: float
    symmetries: Floats


@dataclass(frozen=True, kw_only=True)
class Photo:
    """intrinsics: K; depth_mm: (H, W) planar z, 0 where unknown."""

    intrinsics: Floats
    depth_mm: Floats


def mssd(model: Model, pose: Floats, true: Floats) -> float:
    """The largest distance of a vertex from its true place, by best symmetry; poses (3, 4)."""
    mine = transform_points(pose, model.vertices.astype(np.float64))
    return min(_farthest(mine, theirs) for theirs in _alike(model, true))


def mspd(model: Model, pose: Floats, true: Floats, photo: Photo) -> float:
    """The same in the picture, in pixels; poses (3, 4)."""
    mine = _project(transform_points(pose, model.vertices.astype(np.float64)), photo.intrinsics)
    alike = _alike(model, true)
    return min(_farthest(mine, _project(theirs, photo.intrinsics)) for theirs in alike)


def vsd(
    model: Model, pose: Floats, true: Floats, photo: Photo, taus: Sequence[float]
) -> list[float]:
    """Visible surface discrepancy for each tolerance, over the diameter; poses (3, 4)."""
    measured = _distances(photo.depth_mm, photo.intrinsics)
    mine, theirs = (
        _distances(drawn_depth(model, p, photo), photo.intrinsics) for p in (pose, true)
    )
    true_visible = visible_bop19(measured, theirs)
    visible = visible_bop19(measured, mine) | (true_visible & (mine > 0))
    both, either = true_visible & visible, true_visible | visible
    n = int(either.sum())
    if not n:
        return [1.0] * len(taus)
    apart = np.abs(theirs[both] - mine[both]) / model.diameter
    alone = n - int(both.sum())
    return [(int((apart >= tau).sum()) + alone) / n for tau in taus]


def drawn_depth(model: Model, pose: Floats, photo: Photo) -> Floats:
    """(H, W) planar z of a model, 0 where it is not seen."""
    k = photo.intrinsics
    surfaces = Surfaces(
        vertices=model.vertices,
        triangles=model.triangles,
        vertex_start=np.array([0, len(model.vertices)], np.int64),
        triangle_start=np.array([0, len(model.triangles)], np.int64),
        placement_mesh=np.zeros(1, np.int32),
        cam_from_mesh=np.ascontiguousarray(pose[None]),
        placement_id=np.zeros(1, np.int32),
        cutouts=None,
    )
    camera = Projection(
        orthographic=False, fx=k[0, 0], fy=k[1, 1], cx=k[0, 2] + 0.5, cy=k[1, 2] + 0.5,
        z_near=1.0, z_far=1e7,
    )  # fmt: skip
    height, width = photo.depth_mm.shape
    depth = render(surfaces, camera, (width, height)).depth_z_m.astype(np.float64)
    depth[~np.isfinite(depth)] = 0
    return depth


def symmetries(info: Mapping[str, Any]) -> Floats:
    """(S, 3, 4) of an entry of models_info.json: discrete ones, turned by steps of continuous."""
    discrete = [np.eye(3, 4)]
    discrete += [np.reshape(s, (4, 4))[:3] for s in info.get("symmetries_discrete", ())]
    steps = math.ceil(math.pi / _SYMMETRY_STEP)
    turns = [np.eye(3, 4)]
    for one in info.get("symmetries_continuous", ()):
        offset = np.array(one["offset"], np.float64)
        for k in range(1, steps):
            turn = _rotation(np.array(one["axis"], np.float64), math.tau * k / steps)
            turns.append(np.column_stack([turn, offset - turn @ offset]))
    return np.array(
        [
            np.column_stack([t[:, :3] @ d[:, :3], t[:, :3] @ d[:, 3] + t[:, 3]])
            for d in discrete
            for t in turns
        ]
    )


def _rotation(axis: Floats, angle: float) -> Floats:
    x, y, z = axis / np.linalg.norm(axis)
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: Floats = np.eye(3) + math.sin(angle) * across + (1 - math.cos(angle)) * across @ across
    return turn


def _alike(model: Model, true: Floats) -> list[Floats]:
    """The model's vertices in its true pose, for every symmetry."""
    points = model.vertices.astype(np.float64)
    return [transform_points(true, transform_points(s, points)) for s in model.symmetries]


def _farthest(mine: Floats, theirs: Floats) -> float:
    return float(np.sqrt(((mine - theirs) ** 2).sum(axis=1)).max())


def _project(points: Floats, k: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = points @ k.T
        return np.asarray(plane[:, :2] / plane[:, 2:])


def _distances(depth: Floats, k: Floats) -> Floats:
    """Distance from the camera's centre of planar depths."""
    y, x = np.indices(depth.shape)
    rays = ((x - k[0, 2]) / k[0, 0]) ** 2 + ((y - k[1, 2]) / k[1, 1]) ** 2 + 1
    return np.asarray(depth * np.sqrt(rays))
