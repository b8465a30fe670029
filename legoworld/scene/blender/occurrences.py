"""Walking the render's dependency graph: what occurs where, and which mesh it shows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import NonFiniteGeometryError
from legoworld.scene.blender.alpha_table import AlphaTable
from legoworld.scene.blender.meshes import MeshArrays, corner_uv, mesh_arrays

_UNUSED: Final = 2147483647  # what Blender fills persistent_id with
#: Blender renders these through a mesh that it reports as an occurrence of its own.
_MESHED_ELSEWHERE: Final = ("CURVE", "FONT", "META", "SURFACE")
_NOT_A_SURFACE: Final = ("EMPTY", "CAMERA", "LIGHT", "LIGHT_PROBE", "SPEAKER", "ARMATURE",
                         "LATTICE", "VOLUME")  # fmt: skip

Identity = tuple[str, str]  # name, library


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One entry of the dependency graph, copied.

    path: outermost index first, empty for an object that no instancer made.
    """

    top: Identity
    path: tuple[int, ...]
    object: Identity
    mesh: int  # -1: shows nothing
    holdout: bool
    world_from_mesh: tuple[float, ...]  # 12 numbers, row major


@dataclass(kw_only=True)
class Walk:
    """Everything one walk over the dependency graph copied."""

    seen: list[Seen] = field(default_factory=list)
    meshes: list[MeshArrays] = field(default_factory=list)
    mesh_cutouts: list[tuple[NDArray[np.int32], NDArray[np.float32]] | None] = field(
        default_factory=list
    )
    alphas: AlphaTable = field(default_factory=AlphaTable)
    warnings: set[str] = field(default_factory=set)


def identity(block: Any) -> Identity:
    """A datablock's name and the path of the library it comes from ("" for none)."""
    return (block.name, block.library.filepath if block.library else "")


def walk(depsgraph: Any) -> Walk:
    """Copy all occurrences and every mesh they show. Raises NonFiniteGeometryError."""
    result = Walk()
    known: dict[tuple[int, tuple[int, ...]], int] = {}
    for instance in depsgraph.object_instances:
        shown = instance.object
        original = shown.original
        parent = instance.parent if instance.is_instance else None
        mesh = -1
        if shown.type == "MESH":
            if _camera_sees(instance, shown, parent, depsgraph):
                mesh = _mesh_index(result, known, instance, shown)
        elif shown.type not in _NOT_A_SURFACE and shown.type not in _MESHED_ELSEWHERE:
            result.warnings.add(
                f"{shown.type.lower()} object {original.name!r} is not read: it has no mesh"
            )
        _note_hair(result, shown, original)
        path = tuple(i for i in instance.persistent_id if i != _UNUSED) if parent else ()
        result.seen.append(
            Seen(
                top=identity((parent or shown).original),
                path=path[::-1],
                object=identity(original),
                mesh=mesh,
                holdout=mesh >= 0 and _is_holdout(shown, parent, depsgraph),
                world_from_mesh=_matrix(instance, original) if mesh >= 0 else (0.0,) * 12,
            )
        )
    return result


def _camera_sees(instance: Any, shown: Any, parent: Any, depsgraph: Any) -> bool:
    """Cycles' rule: the object's own camera visibility and its instancer's both count."""
    if not instance.show_self or not shown.visible_camera:
        return False
    if parent is not None and not parent.visible_camera:
        return False
    return not (parent or shown).original.indirect_only_get(
        view_layer=depsgraph.view_layer_eval
    )


def _is_holdout(shown: Any, parent: Any, depsgraph: Any) -> bool:
    holder = (parent or shown).original
    return bool(holder.holdout_get(view_layer=depsgraph.view_layer_eval) or shown.is_holdout)


def _matrix(instance: Any, original: Any) -> tuple[float, ...]:
    rows = tuple(x for row in instance.matrix_world[:3] for x in row)
    if not np.isfinite(rows).all():
        raise NonFiniteGeometryError(
            f"object {original.name!r} stands nowhere",
            found="its world matrix holds NaN or infinity",
            expected="finite numbers",
            next_step="correct its location, rotation, scale, constraints or drivers",
        )
    return rows


def _mesh_index(
    result: Walk, known: dict[tuple[int, tuple[int, ...]], int], instance: Any, shown: Any
) -> int:
    """The index of the mesh an occurrence shows, copied on first sight; -1 when it has no face."""
    mesh = shown.data
    if not len(mesh.polygons):
        return -1
    materials = _materials(instance, shown, mesh)
    slots = tuple(result.alphas.index(material, result.warnings) for material in materials)
    key = (mesh.as_pointer(), slots if any(slots) else ())
    if key not in known:
        arrays = mesh_arrays(mesh)
        if not np.isfinite(arrays.vertices).all():
            raise NonFiniteGeometryError(
                f"mesh of object {shown.original.name!r} has broken vertices",
                found=f"{int((~np.isfinite(arrays.vertices)).any(1).sum())} of "
                f"{len(arrays.vertices)} vertices hold NaN or infinity",
                expected="finite coordinates",
                next_step="remove those vertices, or the modifier that makes them",
            )
        known[key] = _add_mesh(result, mesh, arrays, slots)
    return known[key]


def _add_mesh(result: Walk, mesh: Any, arrays: MeshArrays, slots: tuple[int, ...]) -> int:
    cutout = None
    if any(slots):
        slot = np.minimum(arrays.material, len(slots) - 1)
        slot_cutout, slot_gone = result.alphas.per_slot(slots)
        keep = ~slot_gone[np.maximum(slot, 0)]
        triangle_cutout = slot_cutout[np.maximum(slot, 0)][keep]
        corners = arrays.corners[keep]
        arrays = MeshArrays(
            vertices=arrays.vertices,
            triangles=np.ascontiguousarray(arrays.triangles[keep]),
            corners=corners,
            material=arrays.material[keep],
        )
        if (triangle_cutout >= 0).any():
            cutout = _with_uv(result, mesh, corners, triangle_cutout)
    if not len(arrays.triangles):
        return -1
    result.meshes.append(arrays)
    result.mesh_cutouts.append(cutout)
    return len(result.meshes) - 1


def _with_uv(
    result: Walk, mesh: Any, corners: NDArray[np.int32], triangle_cutout: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.float32]] | None:
    """Each cut-out triangle's texture coordinates; opaque where the UV map is not there."""
    uv = np.zeros((len(corners), 3, 2), np.float32)
    final = np.full(len(corners), -1, np.int32)
    for index in np.unique(triangle_cutout[triangle_cutout >= 0]):
        rule = result.alphas.images[index]
        values = corner_uv(mesh, rule.uv_map, corners)
        if values is None:
            # Cycles then reads (0, 0, 0) everywhere: the picture's lower left corner.
            values = uv
        chosen = triangle_cutout == index
        uv[chosen], final[chosen] = values[chosen], index
    return final, uv


def _materials(instance: Any, shown: Any, mesh: Any) -> list[Any]:
    """Materials by slot as Cycles finds them: a generated mesh has only the mesh's own."""
    generated = instance.is_instance and instance.parent.original == shown.original
    if generated:
        return list(mesh.materials)
    return [slot.material for slot in shown.material_slots] or list(mesh.materials)


def _note_hair(result: Walk, shown: Any, original: Any) -> None:
    for system in getattr(shown, "particle_systems", ()):
        settings = system.settings
        if settings.type == "HAIR" and settings.render_type == "PATH":
            result.warnings.add(f"hair of object {original.name!r} is not read: it has no mesh")
