"""A parsed scene.glb to a Snapshot, in Blender's world."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import NoMeshError, NonFiniteGeometryError
from legoworld.scene.gltf.accessors import Accessors, as_float32
from legoworld.scene.gltf.buffers import Buffers
from legoworld.scene.gltf.cameras import picture_size_wh, scene_camera, scene_cameras
from legoworld.scene.gltf.container import Glb
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.meshes import Meshes, Part
from legoworld.scene.gltf.nodes import BLENDER_FROM_GLTF, Node, Tree, node_tree, transforms
from legoworld.scene.gltf.verdicts import Budget, unreadable
from legoworld.scene.snapshot import RenderSettings, SceneObject, Snapshot
from legoworld.scene.triangle_cuts import cut_arrays

_INSTANCING: Final = "EXT_mesh_gpu_instancing"
_LARGEST: Final = 1e20  # as in `nodes`
_INT32: Final = 2**31 - 1


def read_glb_snapshot(
    glb: Glb, folder: Path, *, any_camera: bool = False, corner_normals: bool = False
) -> Snapshot:
    """Read the default scene of a .glb. SceneInvalidError, NoMeshError among them.

    any_camera: give a scene without a camera one of Blender's default settings.

    folder: where the files lie that it names, if any. glTF's unit is the metre; it holds no
    picture size, so the render settings are of the camera's aspect and a warning says so.
    """
    document, budget = glb.document, Budget(glb.file_bytes)
    tree = node_tree(document)
    camera, aspect, camera_warnings = scene_camera(document, tree, any_camera=any_camera)
    buffers = Buffers(glb, folder, budget)
    accessors = Accessors(document, buffers, budget)
    meshes = Meshes(document, tree, buffers, accessors, budget, with_normals=corner_normals)
    order = sorted(tree.nodes, key=lambda node: (node.name, node.index))
    placed = _placements(order, tree, meshes, accessors, budget)
    if not placed["surface_mesh"].size:
        raise NoMeshError(
            "nothing in scene.glb is a surface",
            found=f"{len(tree.nodes)} nodes, none with a visible triangle",
            expected="at least one mesh with triangles",
            next_step="check what was exported, and material alpha",
        )
    size = picture_size_wh(aspect)
    warnings = [*tree.warnings, *camera_warnings, _size_warning(size, aspect)]
    if document.children("animations"):
        warnings.append("scene.glb holds animations: the pose that its nodes store was read")
    return Snapshot(
        objects=_objects(order),
        collections=(),
        camera=camera,
        cameras=scene_cameras(document, tree),
        render=_render_settings(size, tree.scene_name),
        warnings=(*warnings, *sorted(meshes.warnings)),
        **placed,
        **_geometry(meshes.parts, budget),
        **_cutouts(meshes),
        corner_normal=_corner_normals(meshes.parts, budget) if corner_normals else None,
    )


def _placements(
    order: list[Node], tree: Tree, meshes: Meshes, accessors: Accessors, budget: Budget
) -> dict[str, Any]:
    """Occurrences and surfaces: one a node, or one an instance of EXT_mesh_gpu_instancing."""
    shown: list[int] = []
    surface_occurrence: list[int] = []
    surface_mesh: list[int] = []
    matrices: list[NDArray[np.float64]] = []
    for place, node in enumerate(order):
        mesh = meshes.index(node) if node.mesh >= 0 and node.visible else -1
        if mesh < 0:
            shown.append(place)
            continue
        world = _world_matrices(node, tree, accessors, budget)
        surface_occurrence += range(len(shown), len(shown) + len(world))
        shown += [place] * len(world)
        surface_mesh += [mesh] * len(world)
        matrices.append(world)
    world_from_mesh = np.concatenate([*matrices, np.empty((0, 4, 4))])
    return {
        "occurrence_object": np.array(shown, np.int32),
        "occurrence_instancer": np.full(len(shown), -1, np.int32),
        "occurrence_frame": np.zeros(len(shown), np.int32),
        "surface_occurrence": np.array(surface_occurrence, np.int32),
        "surface_mesh": np.array(surface_mesh, np.int32),
        "surface_holdout": np.zeros(len(surface_mesh), np.uint8),
        "world_from_mesh": np.ascontiguousarray((BLENDER_FROM_GLTF @ world_from_mesh)[:, :3]),
    }


def _world_matrices(
    node: Node, tree: Tree, accessors: Accessors, budget: Budget
) -> NDArray[np.float64]:
    """(n, 4, 4) glTF-world-from-mesh matrices of a node; skinned vertices are in the world."""
    if node.skin >= 0:
        return np.eye(4)[None]
    world: NDArray[np.float64] = tree.world_from_node[node.index][None]
    instancing = node.fields.extension(_INSTANCING)
    if instancing is None:
        return world
    columns: dict[str, NDArray[np.float64]] = {}
    attributes = instancing.child("attributes")
    for name, size in (("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3)):
        if name in attributes:
            index = attributes.index(name, len(accessors))
            budget.take(accessors.layout(index).count * 256, attributes.place)
            stored = as_float32(accessors.read(index))
            if stored.shape[1] != size:
                raise attributes.wrong(name, f"an accessor of VEC{size}")
            columns[name] = stored.astype(np.float64)
    counts = {len(values) for values in columns.values()}
    if len(counts) > 1:
        raise unreadable(f"{attributes.place} has {sorted(counts)} instances", "one count")
    count = counts.pop() if counts else 1
    local = transforms(
        columns.get("TRANSLATION", np.zeros((count, 3))),
        columns.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))),
        columns.get("SCALE", np.ones((count, 3))),
    )
    with np.errstate(all="ignore"):
        world = world @ local
    if not (np.abs(world) <= _LARGEST).all():
        raise NonFiniteGeometryError(
            f"an instance of node {node.name!r} stands nowhere",
            found="its world matrix holds NaN, infinity or a number beyond 1e20",
            expected="finite numbers",
            next_step="correct the instances' translations, rotations and scales",
        )
    return world


def _objects(order: list[Node]) -> tuple[SceneObject, ...]:
    place = {node.index: i for i, node in enumerate(order)}
    return tuple(
        SceneObject(
            name=node.name,
            library=None,
            type=node.type,
            parent=place.get(node.parent, -1),
            collections=(),
            instance_type="NONE",
            properties=node.properties,
        )
        for node in order
    )


def _geometry(meshes: list[tuple[Part, ...]], budget: Budget) -> dict[str, Any]:
    """All meshes one after another; parts that share their vertices store them once."""
    sources: list[NDArray[np.float32]] = []
    bases: list[list[int]] = []
    vertex_start, triangle_start = [0], [0]
    for parts in meshes:
        known: dict[tuple[Any, ...], int] = {}
        count = 0
        for part in parts:
            if part.shared not in known:
                known[part.shared] = count
                count += len(part.vertices)
                sources.append(part.vertices)
        bases.append([known[part.shared] for part in parts])
        vertex_start.append(vertex_start[-1] + count)
        triangle_start.append(triangle_start[-1] + sum(len(p.triangles) for p in parts))
        if max(count, triangle_start[-1] - triangle_start[-2]) > _INT32:
            raise unreadable("a mesh of more than 2^31 vertices or triangles")
    budget.take(12 * (vertex_start[-1] + triangle_start[-1]), "the geometry")
    triangles = np.empty((triangle_start[-1], 3), np.int32)
    row = 0
    for parts, base_of_parts in zip(meshes, bases, strict=True):
        for part, base in zip(parts, base_of_parts, strict=True):
            rows = triangles[row : row + len(part.triangles)]
            rows[:] = part.triangles
            if base:
                rows += np.int32(base)
            row += len(rows)
    return {
        "vertices": np.concatenate(sources, out=np.empty((vertex_start[-1], 3), np.float32)),
        "triangles": triangles,
        "vertex_start": np.array(vertex_start, np.int64),
        "triangle_start": np.array(triangle_start, np.int64),
    }


def _corner_normals(meshes: list[tuple[Part, ...]], budget: Budget) -> NDArray[np.float32]:
    """(T, 3, 3) of all triangles; 0 of primitives without normals, which glTF has flat."""
    parts = [part for parts in meshes for part in parts]
    budget.take(36 * sum(len(part.triangles) for part in parts), "the normals")
    return np.concatenate(
        [
            np.zeros((len(part.triangles), 3, 3), np.float32)
            if part.normals is None
            else part.normals[part.triangles]
            for part in parts
        ]
    )


def _cutouts(meshes: Meshes) -> dict[str, Any]:
    if not meshes.pictures.cutouts:
        return {}
    parts = [part for of_mesh in meshes.parts for part in of_mesh]
    return {
        "cutouts": tuple(meshes.pictures.cutouts),
        "cutout_alphas": tuple(meshes.pictures.alphas),
        **cut_arrays([(part.cut, len(part.triangles)) for part in parts]),
    }


def _render_settings(size_wh: tuple[int, int], scene_name: str) -> RenderSettings:
    return RenderSettings(
        resolution_x=size_wh[0],
        resolution_y=size_wh[1],
        resolution_percentage=100,
        pixel_aspect_x=1.0,
        pixel_aspect_y=1.0,
        use_border=False,
        frame=0,
        subframe=0.0,
        unit_system="METRIC",
        unit_scale=1.0,
        scene_name=scene_name,
        view_layer="",
    )


def _size_warning(size_wh: tuple[int, int], aspect: float | None) -> str:
    what = "nor an aspect" if aspect is None else f"only the aspect {aspect:.6g}"
    return (
        f"scene.glb records no picture size, {what}: "
        f"{size_wh[0]}x{size_wh[1]} where none is asked for"
    )


def check_geometry(document: Fields, accessors: Accessors) -> None:
    """Refuse a document without a mesh that has positions, or with an accessor out of range."""
    for index in range(len(accessors)):
        accessors.check(index)
    for mesh in document.children("meshes"):
        for primitive in mesh.children("primitives"):
            attributes = primitive.child("attributes")
            position = attributes.index("POSITION", len(accessors))
            if position >= 0 and accessors.layout(position).count:
                return
    raise unreadable("no mesh with positions", "at least one mesh with positions")
