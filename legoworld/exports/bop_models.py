"""The models of a BOP dataset: PLY files in millimetres, shared by instances of equal shape."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.files import readable_json, write_text
from legoworld.pluralize import plural
from legoworld.readouts.boxes3d import orthonormal
from legoworld.scene.affine import transform_points
from legoworld.scene.instances import Instance
from legoworld.visibility.view import View

#: Metres up to which placements of parts are taken for equal.
_SAME_M: Final = 1e-6
_ROWS: Final = 1024

Floats = NDArray[np.float64]
_Key = tuple[int, bytes, bytes]


@dataclass(frozen=True, kw_only=True)
class _Model:
    """obj_id; centre_m: of the model's box from the origin of the instance's first part."""

    obj_id: int
    centre_m: Floats


class BopModels:
    """Writes each shape once, and knows the pose of each instance of it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._models: dict[_Key, _Model] = {}
        self._info: dict[str, dict[str, Any]] = {}
        self._cut_out: set[int] = set()

    def place(self, scene_id: int, view: View, instance: Instance) -> dict[str, Any]:
        """obj_id, cam_R_m2c and cam_t_m2c of an instance; its model is written where it is new."""
        surfaces = view.surfaces
        own = np.flatnonzero(surfaces.placement_id == instance.id)
        parts = surfaces.cam_from_mesh[own]
        rotation = orthonormal(parts[0, :, :3]).T  # camera from model
        origin_m = parts[0, :, 3] * view.depth_scale
        model_from_part = rotation.T @ parts * view.depth_scale
        model_from_part[:, :, 3] -= rotation.T @ origin_m
        meshes = surfaces.placement_mesh[own]
        rounded = np.rint(model_from_part / _SAME_M).astype(np.int64)
        key = scene_id, meshes.tobytes(), rounded.tobytes()
        if key not in self._models:
            self._models[key] = self._add(view, meshes, model_from_part, instance)
        model = self._models[key]
        place_mm = (origin_m + rotation @ model.centre_m) * 1000
        return {
            "obj_id": model.obj_id,
            "cam_R_m2c": rotation.ravel().tolist(),
            "cam_t_m2c": place_mm.tolist(),
        }

    def write_info(self) -> None:
        """Write models_info.json."""
        self._folder.mkdir(parents=True, exist_ok=True)
        write_text(self._folder / "models_info.json", readable_json(self._info))

    def losses(self) -> list[str]:
        """What the models lack."""
        lost = ["models have neither materials nor normals"]
        if self._cut_out:
            models = plural(len(self._cut_out), "model", "models")
            lost.append(f"alpha cut-outs are not cut out of {models}; masks and depth have them")
        return lost

    def _add(self, view: View, meshes: NDArray[np.int32], parts: Floats, of: Instance) -> _Model:
        surfaces, obj_id = view.surfaces, len(self._models) + 1
        points, faces, count = [], [], 0
        for mesh, part in zip(meshes.tolist(), parts, strict=True):
            first, last = surfaces.triangle_start[mesh : mesh + 2]
            used, corners = np.unique(surfaces.triangles[first:last], return_inverse=True)
            vertices = surfaces.vertices[surfaces.vertex_start[mesh] + used].astype(np.float64)
            points.append(transform_points(part, vertices))
            faces.append(corners.reshape(-1, 3) + count)
            count += len(used)
            cutouts = surfaces.cutouts
            if cutouts is not None and (cutouts.triangle_cutout[first:last] >= 0).any():
                self._cut_out.add(obj_id)
        vertices_m = np.concatenate(points)
        low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
        centre = (low + high) / 2
        vertices_mm = (vertices_m - centre) * 1000
        self._folder.mkdir(parents=True, exist_ok=True)
        data = _ply(vertices_mm, np.concatenate(faces))
        (self._folder / f"obj_{obj_id:06d}.ply").write_bytes(data)
        low, size = (low - centre) * 1000, (high - low) * 1000
        assert of.category is not None
        self._info[str(obj_id)] = {
            "diameter": diameter(vertices_mm),
            **{f"min_{axis}": float(v) for axis, v in zip("xyz", low, strict=True)},
            **{f"size_{axis}": float(v) for axis, v in zip("xyz", size, strict=True)},
            "name": of.name,
            "category": of.category.name,
        }
        return _Model(obj_id=obj_id, centre_m=centre)


def diameter(points: Floats) -> float:
    """The largest distance between two of (n, 3) points."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    reach = np.sqrt(((points - middle) ** 2).sum(axis=1))
    far = points[reach.argmax()]
    least = float(np.sqrt(((points - far) ** 2).sum(axis=1).max()))
    # Of a pair that is farther apart than `least`, neither end is nearer to the middle than this.
    ends = np.unique(points[reach >= least - reach.max() - 1e-9 * reach.max()], axis=0)
    squared = 0.0
    for start in range(0, len(ends), _ROWS):
        some = ends[start : start + _ROWS]
        between = (some**2).sum(axis=1)[:, None] + (ends**2).sum(axis=1) - 2 * some @ ends.T
        squared = max(squared, float(between.max()))
    return math.sqrt(squared)


def _ply(vertices: Floats, faces: NDArray[np.int64]) -> bytes:
    """A binary PLY of float32 vertices and triangles."""
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment millimetres",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    rows = np.empty(len(faces), np.dtype([("n", "u1"), ("corners", "<i4", 3)]))
    rows["n"], rows["corners"] = 3, faces
    text = "\n".join(header) + "\n"
    return text.encode("ascii") + vertices.astype("<f4").tobytes() + rows.tobytes()
