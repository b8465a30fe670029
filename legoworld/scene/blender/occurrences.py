"""A walk over the render's dependency graph: occurrences, their transforms and meshes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import NonFiniteGeometryError
from legoworld.scene.blender.alpha_table import AlphaTable
from legoworld.scene.blender.cut_meshes import MeshCutter
from legoworld.scene.blender.meshes import (
    CopiedMesh,
    Triangles,
    corner_normals,
    mesh_triangles,
    mesh_vertices,
    triangle_materials,
)
from legoworld.scene.blender.objects import ObjectFacts, ObjectTable
from legoworld.scene.blender.placements import NO_MESH, Generator, GraphEntry, Identity
from legoworld.scene.blender.strands import hair_systems
from legoworld.scene.blender.thin_meshes import ThinMeshes
from legoworld.scene.snapshot import LARGEST_COORDINATE, SceneCamera
from legoworld.scene.triangle_cuts import TriangleCuts

if TYPE_CHECKING:
    import bpy
    import mathutils

_MeshAndRules = tuple[int, tuple[int, ...], bool]
"""A mesh's address, the alpha rules of its slots, and whether the object is a holdout."""

_UNUSED: Final = 2147483647  # what Blender fills persistent_id with


@dataclass(kw_only=True)
class Walk:
    """Everything one walk over the dependency graph copied.

    for_camera: whether hair or points were meshed as one camera sees them.
    """

    graph_entries: list[GraphEntry] = field(default_factory=list)
    meshes: list[CopiedMesh] = field(default_factory=list)
    alphas: AlphaTable = field(default_factory=AlphaTable)
    generators: dict[Identity, Generator] = field(default_factory=dict)
    warnings: set[str] = field(default_factory=set)
    for_camera: bool = False


def walk(
    depsgraph: bpy.types.Depsgraph, camera: SceneCamera, *, corner_normals: bool = False
) -> Walk:
    """Copy all occurrences and every mesh they show. Raises NonFiniteGeometryError.

    camera: the one the snapshot will have; hair and points are meshed for it. corner_normals:
    whether meshes have them.
    """
    return _Walker(depsgraph, camera, corner_normals=corner_normals).walk()


class _Walker:
    def __init__(
        self, depsgraph: bpy.types.Depsgraph, camera: SceneCamera, *, corner_normals: bool
    ) -> None:
        self.depsgraph = depsgraph
        self.corner_normals = corner_normals
        self.result = Walk()
        self.objects = ObjectTable(view_layer=depsgraph.view_layer, warnings=self.result.warnings)
        self.override = depsgraph.view_layer_eval.material_override
        self.thin = ThinMeshes(
            camera=camera,
            camera_object=depsgraph.scene_eval.camera,
            curve_settings=depsgraph.scene_eval.cycles_curves,
            renders_hair=depsgraph.view_layer_eval.use_strand,
            meshes=self.result.meshes,
            alphas=self.result.alphas,
            warnings=self.result.warnings,
        )
        self._mesh_of: dict[tuple[int, int, bool], tuple[int, int]] = {}
        self._mesh_by_rule: dict[_MeshAndRules, tuple[int, int]] = {}
        self._unread: dict[_MeshAndRules, set[tuple[int, str]]] = {}

    def walk(self) -> Walk:
        for instance in self.depsgraph.object_instances:
            self._see(instance)
        self.result.generators = self.objects.generators
        self.result.for_camera = self.thin.has_thin_meshes
        _refuse_broken_matrices(self.result.graph_entries)
        return self.result

    def _see(self, instance: bpy.types.DepsgraphObjectInstance) -> None:
        shown = instance.object
        real = instance.instance_object or shown
        facts = self.objects.facts(real)
        holder, path = facts, ()
        if instance.is_instance:
            holder = self.objects.facts(instance.parent)
            path = tuple(i for i in instance.persistent_id if i != _UNUSED)[::-1]
        matrix = instance.matrix_world
        entry = GraphEntry(
            top=holder.identity,
            path=path,
            object=facts.identity,
            by_particles=instance.particle_system is not None,
            world_from_mesh=(*matrix[0], *matrix[1], *matrix[2]),
        )
        visible, held_out = _camera_sees(facts, holder), holder.holdout
        if visible and instance.show_self:
            entry = self._entry_with_shown(entry, shown, matrix, held_out=held_out)
        self.result.graph_entries.append(entry)
        if visible and instance.show_particles and shown.type == "MESH" and _owns(real, shown):
            mesh, holdout = self.thin.hair(real, matrix, self._rules(shown), held_out=held_out)
            if mesh >= 0 or holdout >= 0:
                self.result.graph_entries.append(replace(entry, mesh=mesh, holdout_mesh=holdout))

    def _entry_with_shown(
        self,
        entry: GraphEntry,
        shown: bpy.types.Object,
        matrix: mathutils.Matrix,
        *,
        held_out: bool,
    ) -> GraphEntry:
        """The entry with what it shows itself: its hair is not in it."""
        if shown.type == "MESH":
            mesh, holdout = self._mesh(shown, held_out=held_out)
        elif shown.type == "CURVES":
            rules = self._rules(shown)
            mesh, holdout = self.thin.curves(shown, matrix, rules, held_out=held_out)
        elif shown.type == "POINTCLOUD":
            rules = self._rules(shown)
            return replace(entry, scatter=self.thin.points(shown, matrix, rules, held_out=held_out))
        else:
            self.objects.note_type(shown)
            return entry
        return replace(entry, mesh=mesh, holdout_mesh=holdout)

    def _mesh(self, shown: bpy.types.Object, *, held_out: bool) -> tuple[int, int]:
        """The meshes an entry shows and holds out, copied on first sight, or `NO_MESH`.

        held_out: the whole object is a holdout.
        """
        mesh = shown.data
        pointer = mesh.as_pointer()
        key = (pointer, shown.original.as_pointer(), held_out)
        if key not in self._mesh_of:
            rules = self._rules(shown) if len(mesh.polygons) else ()
            by_rule = (pointer, rules if any(rules) else (), held_out)
            if not rules:
                self._mesh_of[key] = (NO_MESH, NO_MESH)
            elif by_rule in self._mesh_by_rule:
                self._mesh_of[key] = self._mesh_by_rule[by_rule]
            else:
                unread = self._unread.setdefault(by_rule, set())
                made = self._copy(shown, mesh, rules, unread, held_out=held_out)
                self._mesh_of[key] = self._mesh_by_rule[by_rule] = made
            self._warn_unread(shown, rules, self._unread.get(by_rule, set()))
        return self._mesh_of[key]

    def _rules(self, shown: bpy.types.Object) -> tuple[int, ...]:
        """The alpha rule of each material slot."""
        alphas, warnings = self.result.alphas, self.result.warnings
        return tuple(alphas.index(m, warnings) for m in self._materials(shown))

    def _materials(self, shown: bpy.types.Object) -> list[bpy.types.Material | None]:
        """The material of each slot; evaluated slots are what Cycles asks for, too."""
        materials = [slot.material for slot in shown.material_slots] or [None]
        return materials if self.override is None else [self.override] * len(materials)

    def _warn_unread(
        self, shown: bpy.types.Object, rules: tuple[int, ...], unread: set[tuple[int, str]]
    ) -> None:
        """Name the object's own materials: others may have the same rule and the same mesh."""
        for number, why in unread:
            for rule, material in zip(rules, self._materials(shown), strict=True):
                if rule == number and material is not None:
                    self.result.warnings.add(
                        f"material {material.original.name!r}: {why}; its surface is taken as "
                        "opaque"
                    )

    def _copy(
        self,
        shown: bpy.types.Object,
        mesh: bpy.types.Mesh,
        rules: tuple[int, ...],
        unread: set[tuple[int, str]],
        *,
        held_out: bool,
    ) -> tuple[int, int]:
        vertices = mesh_vertices(mesh)
        limit = LARGEST_COORDINATE
        if not (vertices.min() >= -limit and vertices.max() <= limit):
            broken = (~(np.abs(vertices) <= limit)).any(1)
            raise NonFiniteGeometryError(
                f"mesh of object {shown.original.name!r} has broken vertices",
                found=f"{int(broken.sum())} of {len(vertices)} vertices hold NaN, infinity or more "
                f"than {limit:g}",
                expected="finite coordinates",
                next_step="remove those vertices, or the modifier that makes them",
            )
        triangles = mesh_triangles(mesh)
        if not any(rules) and not held_out:  # the usual case: opaque, whatever the slot
            return self._keep(mesh, vertices, triangles, None), NO_MESH
        rule = np.array(rules, np.int32)[np.clip(triangle_materials(mesh), 0, len(rules) - 1)]
        there, hidden = self.result.alphas.is_there(rule), self.result.alphas.is_holdout(rule)
        if held_out:
            there, hidden = np.zeros_like(there), there | hidden
        return (
            self._add(shown, vertices, triangles.select(there), rule[there], unread),
            self._add(shown, vertices, triangles.select(hidden), rule[hidden], unread),
        )

    def _add(
        self,
        shown: bpy.types.Object,
        vertices: NDArray[np.float32],
        triangles: Triangles,
        rule: NDArray[np.int32],
        unread: set[tuple[int, str]],
    ) -> int:
        """Keep these triangles of a mesh as a mesh of their own; `NO_MESH` when there are none."""
        left, cuts = MeshCutter(
            mesh=shown.data,
            evaluated_object=shown,
            alphas=self.result.alphas,
            warnings=self.result.warnings,
            unread=unread,
        ).cut(triangles, rule)
        return self._keep(shown.data, vertices, left, cuts)

    def _keep(
        self,
        mesh: bpy.types.Mesh,
        vertices: NDArray[np.float32],
        triangles: Triangles,
        cuts: TriangleCuts | None,
    ) -> int:
        if not len(triangles.vertices):
            return NO_MESH
        self.result.meshes.append(
            CopiedMesh(
                vertices=vertices,
                triangles=triangles.vertices,
                cuts=cuts,
                corner_normal=corner_normals(mesh, triangles.corners)
                if self.corner_normals
                else None,
            )
        )
        return len(self.result.meshes) - 1


def _camera_sees(facts: ObjectFacts, holder: ObjectFacts) -> bool:
    """Cycles' rule: the object's and its outermost instancer's camera visibility both count.

    Only the outermost instancer's collections count, and a holdout is never indirect only.
    """
    seen = facts.camera_sees and holder.camera_sees
    return seen and (holder.holdout or not holder.indirect)


def _owns(real: bpy.types.Object, shown: bpy.types.Object) -> bool:
    """True if an entry shows its object's own mesh (and hair), not the result of nodes."""
    return bool(hair_systems(real)) and real.data.as_pointer() == shown.data.as_pointer()


def _refuse_broken_matrices(entries: list[GraphEntry]) -> None:
    shows = [s for s in entries if s.mesh >= 0 or s.holdout_mesh >= 0 or s.scatter is not None]
    rows = np.array([s.world_from_mesh for s in shows], np.float64).reshape(-1, 12)
    broken = np.flatnonzero(~(np.abs(rows) <= LARGEST_COORDINATE).all(1))
    if not len(broken):
        return
    first = min((shows[i] for i in broken), key=lambda s: (s.object, s.top, s.path))
    raise NonFiniteGeometryError(
        f"object {first.object[0]!r} stands nowhere",
        found=f"its world matrix holds NaN, infinity or more than {LARGEST_COORDINATE:g}",
        expected="finite numbers",
        next_step="correct its location, rotation, scale, constraints or drivers",
    )
