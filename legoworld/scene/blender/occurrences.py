"""Walking the render's dependency graph: what occurs where, and which mesh it shows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import NonFiniteGeometryError
from legoworld.scene.blender.alpha_table import AlphaTable
from legoworld.scene.blender.meshes import Triangles, corner_uv, mesh_triangles, mesh_vertices
from legoworld.scene.blender.objects import ObjectFacts, ObjectTable
from legoworld.scene.blender.placements import Generator, Identity, Seen

_UNUSED: Final = 2147483647  # what Blender fills persistent_id with
#: Far beyond any scene, and small enough that a product of two such numbers is finite.
_LARGEST_ENTRY: Final = 1e15


@dataclass(kw_only=True)
class CopiedMesh:
    """One mesh as it shows, in its own frame: faces that alpha removes are left out.

    vertices: (V, 3) float32; triangles: (T, 3) int32. cutout: (T,) int32 index into the walk's
    alpha images, -1 for none, with (T, 3, 2) float32 texture coordinates; None where no triangle
    has one.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    cutout: tuple[NDArray[np.int32], NDArray[np.float32]] | None


@dataclass(kw_only=True)
class Walk:
    """Everything one walk over the dependency graph copied."""

    seen: list[Seen] = field(default_factory=list)
    meshes: list[CopiedMesh] = field(default_factory=list)
    alphas: AlphaTable = field(default_factory=AlphaTable)
    generators: dict[Identity, Generator] = field(default_factory=dict)
    warnings: set[str] = field(default_factory=set)


def walk(depsgraph: Any) -> Walk:
    """Copy all occurrences and every mesh they show. Raises NonFiniteGeometryError."""
    return _Walker(depsgraph).walk()


class _Walker:
    def __init__(self, depsgraph: Any) -> None:
        self.depsgraph = depsgraph
        self.result = Walk()
        self.objects = ObjectTable(
            view_layer=depsgraph.view_layer, warnings=self.result.warnings
        )
        self.override = depsgraph.view_layer_eval.material_override
        self._mesh_of: dict[tuple[int, int], int] = {}
        self._mesh_by_rule: dict[tuple[int, tuple[int, ...]], int] = {}

    def walk(self) -> Walk:
        for instance in self.depsgraph.object_instances:
            self.result.seen.append(self._seen(instance))
        self.result.generators = self.objects.generators
        _refuse_broken_matrices(self.result.seen)
        return self.result

    def _seen(self, instance: Any) -> Seen:
        shown = instance.object
        facts = self.objects.facts(instance.instance_object or shown)
        holder, path, by_particles = facts, (), False
        if instance.is_instance:
            holder = self.objects.facts(instance.parent)
            path = tuple(i for i in instance.persistent_id if i != _UNUSED)[::-1]
            by_particles = instance.particle_system is not None
        mesh = -1
        if shown.type != "MESH":
            self.objects.note_type(shown)
        elif instance.show_self and _camera_sees(facts, holder):
            mesh = self._mesh(shown)
        matrix = instance.matrix_world
        return Seen(
            top=holder.identity,
            path=path,
            object=facts.identity,
            mesh=mesh,
            holdout=mesh >= 0 and holder.holdout,
            by_particles=by_particles,
            world_from_mesh=(*matrix[0], *matrix[1], *matrix[2]),
        )

    def _mesh(self, shown: Any) -> int:
        """The index of the mesh an entry shows, copied on first sight; -1 when it has no face."""
        mesh = shown.data
        pointer = mesh.as_pointer()
        key = (pointer, shown.original.as_pointer())
        if key not in self._mesh_of:
            if not len(mesh.polygons):
                self._mesh_of[key] = -1
                return -1
            rules = self._rules(shown)
            by_rule = (pointer, rules if any(rules) else ())
            if by_rule not in self._mesh_by_rule:
                self._mesh_by_rule[by_rule] = self._copy(shown, mesh, rules)
            self._mesh_of[key] = self._mesh_by_rule[by_rule]
        return self._mesh_of[key]

    def _rules(self, shown: Any) -> tuple[int, ...]:
        """The alpha rule of each material slot; evaluated slots are what Cycles asks for, too."""
        materials = [slot.material for slot in shown.material_slots] or [None]
        if self.override is not None:
            materials = [self.override] * len(materials)
        return tuple(self.result.alphas.index(m, self.result.warnings) for m in materials)

    def _copy(self, shown: Any, mesh: Any, rules: tuple[int, ...]) -> int:
        vertices = mesh_vertices(mesh)
        if not np.isfinite(vertices).all():
            raise NonFiniteGeometryError(
                f"mesh of object {shown.original.name!r} has broken vertices",
                found=f"{int((~np.isfinite(vertices)).any(1).sum())} of {len(vertices)} vertices "
                "hold NaN or infinity",
                expected="finite coordinates",
                next_step="remove those vertices, or the modifier that makes them",
            )
        triangles = mesh_triangles(mesh)
        cutout = None
        if any(rules):
            triangles, cutout = self._cut(mesh, triangles, rules)
        if not len(triangles.vertices):
            return -1
        self.result.meshes.append(
            CopiedMesh(vertices=vertices, triangles=triangles.vertices, cutout=cutout)
        )
        return len(self.result.meshes) - 1

    def _cut(
        self, mesh: Any, triangles: Triangles, rules: tuple[int, ...]
    ) -> tuple[Triangles, tuple[NDArray[np.int32], NDArray[np.float32]] | None]:
        """Without the faces whose alpha removes them; with the images that cut the others."""
        slot = np.clip(triangles.material, 0, len(rules) - 1)
        slot_image, slot_gone = self.result.alphas.per_slot(rules)
        keep = ~slot_gone[slot]
        image, triangles = slot_image[slot][keep], triangles.chosen(keep)
        if not (image >= 0).any():
            return triangles, None
        uv = np.zeros((len(image), 3, 2), np.float32)
        for index in np.unique(image[image >= 0]):
            values = corner_uv(mesh, self.result.alphas.images[index].uv_map, triangles.corners)
            # Without that UV map Cycles reads (0, 0) everywhere: the picture's lower left corner.
            if values is not None:
                uv[image == index] = values[image == index]
        if not np.isfinite(uv).all():
            self.result.warnings.add(
                f"mesh {mesh.name!r} has texture coordinates that are NaN or infinite: read as 0"
            )
            uv[~np.isfinite(uv)] = 0.0
        return triangles, (image, uv)


def _camera_sees(facts: ObjectFacts, holder: ObjectFacts) -> bool:
    """Cycles' rule: the object's and its outermost instancer's camera visibility both count.

    Only the outermost instancer's collections count, and a holdout is never indirect only.
    """
    if not facts.camera_sees or not holder.camera_sees:
        return False
    return holder.holdout or not holder.indirect


def _refuse_broken_matrices(seen: list[Seen]) -> None:
    shows = [s for s in seen if s.mesh >= 0]
    rows: NDArray[np.float64] = np.array([s.world_from_mesh for s in shows], np.float64).reshape(-1, 12)
    broken = np.flatnonzero(~(np.abs(rows) <= _LARGEST_ENTRY).all(1))
    if not len(broken):
        return
    first = min((shows[i] for i in broken), key=lambda s: (s.object, s.top, s.path))
    raise NonFiniteGeometryError(
        f"object {first.object[0]!r} stands nowhere",
        found=f"its world matrix holds NaN, infinity or more than {_LARGEST_ENTRY:g}",
        expected="finite numbers",
        next_step="correct its location, rotation, scale, constraints or drivers",
    )
