"""The snapshot: what a frozen scene holds, as plain arrays; everything after it is Blender-free."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import SceneInvalidError, cause
from legoworld.files import canonical_json
from legoworld.scene.array_file import read_arrays, write_arrays

#: Raised whenever the meaning of a snapshot changes; part of every cache key.
SNAPSHOT_SCHEMA: Final = 5

#: Coordinates and matrix entries beyond this are refused: no scene needs them, and products of two
#: stay finite.
LARGEST_COORDINATE: Final = 1e15

ARRAYS: Final = {
    "vertices": np.float32,
    "triangles": np.int32,
    "vertex_start": np.int64,
    "triangle_start": np.int64,
    "occurrence_object": np.int32,
    "occurrence_instancer": np.int32,
    "occurrence_frame": np.int32,
    "surface_occurrence": np.int32,
    "surface_mesh": np.int32,
    "surface_holdout": np.uint8,
    "world_from_mesh": np.float64,
}


@dataclass(frozen=True, kw_only=True)
class SceneObject:
    """One object datablock: its place in the object tree and its label properties."""

    name: str
    library: str | None
    type: str
    parent: int  # index into Snapshot.objects, -1 for none
    collections: tuple[int, ...]  # the collections that hold it directly
    instance_type: str  # how it generates instances: NONE, COLLECTION, VERTS or FACES
    properties: dict[str, str]  # custom properties that are labels, as text


@dataclass(frozen=True, kw_only=True)
class SceneCollection:
    """One collection: the collections it lies in and its label properties."""

    name: str
    library: str | None
    parents: tuple[int, ...]
    properties: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class SceneCamera:
    """The active camera, in Blender's own terms; `visibility.camera` turns it into pixels.

    world_from_camera: (3, 4), rows of the transform from OpenCV camera axes (x right, y down,
    z forward) to the world, each axis of unit length: the scale of the camera object is removed.
    """

    name: str
    type: Literal["PERSP", "ORTHO"]
    world_from_camera: tuple[tuple[float, float, float, float], ...]
    lens_mm: float
    sensor_width_mm: float
    sensor_height_mm: float
    sensor_fit: Literal["AUTO", "HORIZONTAL", "VERTICAL"]
    shift_x: float
    shift_y: float
    ortho_scale: float
    clip_start: float
    clip_end: float


@dataclass(frozen=True, kw_only=True)
class RenderSettings:
    """What the scene says about its picture and its units."""

    resolution_x: int
    resolution_y: int
    resolution_percentage: int
    pixel_aspect_x: float
    pixel_aspect_y: float
    use_border: bool
    frame: int
    subframe: float
    unit_system: str
    unit_scale: float  # metres per scene unit
    scene_name: str
    view_layer: str

    @property
    def size_wh(self) -> tuple[int, int]:
        """The picture's size as Blender computes it: percentage applied, rounded down."""
        share = self.resolution_percentage
        return (max(1, self.resolution_x * share // 100), max(1, self.resolution_y * share // 100))


Wrap = Literal["repeat", "extend", "clip", "mirror"]
Interpolation = Literal["closest", "linear"]
Sides = Literal["both", "front", "back"]


@dataclass(frozen=True, kw_only=True)
class Cutout:
    """What decides where a surface is there; see `visibility.kernel.Cutouts`.

    An image of one opaque texel where only the corners' alpha or the side that is seen decides.
    """

    name: str
    wrap: Wrap
    interpolation: Interpolation
    sides: Sides = "both"


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """A scene's surfaces, who they belong to, its camera and its units.

    vertices: (V, 3) float32, all meshes one after another, each in its own frame.
    triangles: (T, 3) int32, vertex indices local to the mesh.
    vertex_start, triangle_start: (M + 1,) int64, where each mesh begins.

    An occurrence is an object as it occurs in the evaluated scene; instancing makes many of one.
    occurrence_object: (K,) int32 into `objects`. occurrence_instancer: (K,) int32, the occurrence
    that generated it, -1 for the scene itself. occurrence_frame: (K,) int32, equal for the members
    of one placement of what an instancer generates.

    A surface is one mesh placed once, and belongs to an occurrence. Hair is meshed for `camera`,
    once for each of its placements; the points of a point cloud are placements of spheres.
    surface_occurrence, surface_mesh: (S,) int32. surface_holdout: (S,) uint8, 1 where the surface
    hides what is behind it and is itself not seen. world_from_mesh: (S, 3, 4) float64.

    Cut-outs, empty where no material needs one: triangle_cutout (T,) int32, corner_uv (T, 3, 2)
    float32, and one (H, W) uint8 alpha picture, top row first, per entry of `cutouts`.
    corner_alpha (T, 3) float32, empty where no attribute of a mesh decides: 1 where the triangle's
    own does not.

    cameras: all that can be read, by name; for_camera: whether hair or points are meshed for
    `camera` alone. No part of the content hash: no picture through `camera` depends on them.

    corner_normal: (T, 3, 3) float32, None where it was not asked for: in the mesh's frame, 0 of
    triangles that are flat. It is not part of `content_sha256`, which is that of the scene whatever
    is asked of it.
    """

    objects: tuple[SceneObject, ...]
    collections: tuple[SceneCollection, ...]
    camera: SceneCamera
    render: RenderSettings
    warnings: tuple[str, ...]
    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    vertex_start: NDArray[np.int64]
    triangle_start: NDArray[np.int64]
    occurrence_object: NDArray[np.int32]
    occurrence_instancer: NDArray[np.int32]
    occurrence_frame: NDArray[np.int32]
    surface_occurrence: NDArray[np.int32]
    surface_mesh: NDArray[np.int32]
    surface_holdout: NDArray[np.uint8]
    world_from_mesh: NDArray[np.float64]
    cutouts: tuple[Cutout, ...] = ()
    triangle_cutout: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, np.int32))
    corner_uv: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 3, 2), np.float32))
    cutout_alphas: tuple[NDArray[np.uint8], ...] = ()
    corner_alpha: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 3), np.float32))
    cameras: tuple[SceneCamera, ...] = ()
    for_camera: bool = False
    corner_normal: NDArray[np.float32] | None = None

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array but corner_normal by name, in a fixed order."""
        named: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in ARRAYS}
        if self.cutouts:
            named["triangle_cutout"] = self.triangle_cutout
            named["corner_uv"] = self.corner_uv
            named |= {f"cutout_alpha_{i}": a for i, a in enumerate(self.cutout_alphas)}
        if len(self.corner_alpha):
            named["corner_alpha"] = self.corner_alpha
        return named

    def description(self) -> dict[str, Any]:
        """Everything that is not an array, as JSON values."""
        return {
            "schema": SNAPSHOT_SCHEMA,
            "objects": [vars(o) for o in self.objects],
            "collections": [vars(c) for c in self.collections],
            "camera": vars(self.camera),
            "render": vars(self.render),
            "warnings": self.warnings,
            "cutouts": [vars(c) for c in self.cutouts],
        }

    def camera_description(self) -> dict[str, Any]:
        """What is stored beside the content, as JSON values."""
        return {"cameras": [vars(c) for c in self.cameras], "for_camera": self.for_camera}

    def content_sha256(self) -> str:
        """Hex sha256 over all values; file names, file times and dict order do not enter."""
        return self._sha256(canonical_json(self.description()))

    def _sha256(self, description: str) -> str:
        digest = hashlib.sha256(description.encode("utf-8"))
        for name, array in self.arrays().items():
            digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
            digest.update(np.ascontiguousarray(array).data)
        return digest.hexdigest()

    @property
    def n_triangles(self) -> int:
        """Triangles of all placements, each mesh counted as often as it is placed."""
        return int(np.diff(self.triangle_start)[self.surface_mesh].sum())


def save(snapshot: Snapshot, path: Path, *, passing: bool = False) -> str:
    """Write a snapshot, whole or not at all; returns its content hash.

    passing: as `write_arrays` has it.
    """
    description = canonical_json(snapshot.description())
    content = snapshot._sha256(description)
    stored: dict[str, NDArray[Any]] = {
        "description": np.frombuffer(description.encode("utf-8"), np.uint8),
        "content_sha256": np.frombuffer(content.encode("ascii"), np.uint8),
        "cameras": np.frombuffer(canonical_json(snapshot.camera_description()).encode(), np.uint8),
    }
    if snapshot.corner_normal is not None:
        stored["corner_normal"] = snapshot.corner_normal
    write_arrays(path, stored | snapshot.arrays(), passing=passing)
    return content


def load(path: Path, *, passing: bool = False) -> tuple[Snapshot, str]:
    """Read a snapshot, its arrays read only, and its content hash.

    SceneInvalidError where the file is not one.
    """
    try:
        arrays = read_arrays(path, passing=passing)
        description = json.loads(arrays.pop("description").tobytes().decode("utf-8"))
        content = arrays.pop("content_sha256").tobytes().decode("ascii")
        description |= json.loads(arrays.pop("cameras").tobytes().decode("utf-8"))
        return _from_parts(description, arrays), content
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SceneInvalidError(
            "a cached snapshot cannot be read",
            found=f"{path.name}: {cause(error)}",
            expected="a snapshot written by this version",
            next_step="run again with --no-cache, or delete the cache folder",
        ) from error


def _from_parts(description: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Snapshot:
    cutouts = tuple(Cutout(**c) for c in description["cutouts"])
    optional: dict[str, Any] = {}
    if cutouts:
        optional = {
            "triangle_cutout": arrays["triangle_cutout"],
            "corner_uv": arrays["corner_uv"],
            "cutout_alphas": tuple(arrays[f"cutout_alpha_{i}"] for i in range(len(cutouts))),
        }
    if "corner_alpha" in arrays:
        optional["corner_alpha"] = arrays["corner_alpha"]
    optional["corner_normal"] = arrays.get("corner_normal")
    required: dict[str, Any] = {name: arrays[name] for name in ARRAYS}
    return Snapshot(
        objects=tuple(
            SceneObject(**{**o, "collections": tuple(o["collections"])})
            for o in description["objects"]
        ),
        collections=tuple(
            SceneCollection(**{**c, "parents": tuple(c["parents"])})
            for c in description["collections"]
        ),
        camera=_camera(description["camera"]),
        cameras=tuple(map(_camera, description["cameras"])),
        for_camera=description["for_camera"],
        render=RenderSettings(**description["render"]),
        warnings=tuple(description["warnings"]),
        cutouts=cutouts,
        **required,
        **optional,
    )


def _camera(values: dict[str, Any]) -> SceneCamera:
    rows = tuple(map(tuple, values["world_from_camera"]))
    return SceneCamera(**{**values, "world_from_camera": rows})
