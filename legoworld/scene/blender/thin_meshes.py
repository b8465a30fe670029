"""Meshes for what Cycles draws without one: hair and points, as the snapshot's camera sees them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import TAKEN_AS_OPAQUE
from legoworld.scene.affine import cam_from_mesh
from legoworld.scene.blender.alpha_table import AlphaTable
from legoworld.scene.blender.meshes import CopiedMesh
from legoworld.scene.blender.placements import NO_MESH, Scatter
from legoworld.scene.blender.strands import (
    HairSystem,
    cloud_points,
    curve_strands,
    hair_systems,
    particle_hair,
)
from legoworld.scene.hair.ribbons import Triangulated, join_meshes, ribbons
from legoworld.scene.hair.spheres import sphere, sphere_levels
from legoworld.scene.hair.strands import Eye, Strands
from legoworld.scene.hair.tubes import linear_tubes, round_tubes
from legoworld.scene.snapshot import SceneCamera

if TYPE_CHECKING:
    import bpy
    import mathutils

#: Embree's limit on the quads of a ribbon between two keys.
_MOST_QUADS: Final = 16

_Drawing = Callable[[Strands, Eye], Triangulated]


@dataclass(kw_only=True)
class ThinMeshes:
    """Makes these meshes, appends them to `meshes`, and reads each thing once.

    renders_hair: of the view layer; has_thin_meshes: whether there is any such mesh.
    """

    camera: SceneCamera
    camera_object: bpy.types.Object
    curve_settings: bpy.types.PropertyGroup
    renders_hair: bool
    meshes: list[CopiedMesh]
    alphas: AlphaTable
    warnings: set[str]
    has_thin_meshes: bool = False
    _systems: dict[int, list[HairSystem]] = field(default_factory=dict)
    _strands: dict[tuple[int, int], tuple[Strands, bool]] = field(default_factory=dict)
    _spheres: dict[int, int] = field(default_factory=dict)

    def hair(
        self,
        real: bpy.types.Object,
        world_from_mesh: mathutils.Matrix,
        rules: tuple[int, ...],
        *,
        held_out: bool,
    ) -> tuple[int, int]:
        """Mesh indices of an object's particle hair, visible and holdout, or `NO_MESH`."""
        key = real.original.as_pointer()
        if key not in self._systems:
            self._systems[key] = [
                particle_hair(real, system, self.camera_object) for system in hair_systems(real)
            ]
        seen: list[Triangulated] = []
        hidden: list[Triangulated] = []
        eye = self._eye(world_from_mesh)
        for system in self._systems[key]:
            rule = rules[min(system.slot, len(rules) - 1)]
            there, holdout = self._visibility(rule, real, held_out=held_out)
            if self.renders_hair and eye is not None and (there or holdout):
                (seen if there else hidden).append(self._by_settings()(system.strands, eye))
        return self._add(seen), self._add(hidden)

    def curves(
        self,
        shown: bpy.types.Object,
        world_from_mesh: mathutils.Matrix,
        rules: tuple[int, ...],
        *,
        held_out: bool,
    ) -> tuple[int, int]:
        """Mesh indices of a hair curves object, visible and holdout, or `NO_MESH`."""
        key = (shown.data.as_pointer(), shown.original.as_pointer())
        if key not in self._strands:
            self._strands[key] = curve_strands(shown)
        strands, straight = self._strands[key]
        there, holdout = self._visibility(rules[0], shown, held_out=held_out)
        eye = self._eye(world_from_mesh)
        if not self.renders_hair or eye is None or not (there or holdout):
            return NO_MESH, NO_MESH
        mesh = self._add([(linear_tubes if straight else self._by_settings())(strands, eye)])
        return (mesh, NO_MESH) if there else (NO_MESH, mesh)

    def points(
        self,
        shown: bpy.types.Object,
        world_from_mesh: mathutils.Matrix,
        rules: tuple[int, ...],
        *,
        held_out: bool,
    ) -> Scatter | None:
        """A sphere placed at each point of a point cloud."""
        points, radius = cloud_points(shown)
        there, holdout = self._visibility(rules[0], shown, held_out=held_out)
        eye = self._eye(world_from_mesh)
        if eye is None or not (there or holdout) or not len(points):
            return None
        levels = sphere_levels(eye.share(points, radius))
        matrix = _rows(world_from_mesh)[0]
        placed = np.empty((len(points), 3, 4), np.float64)
        placed[:, :, :3] = matrix[:, :3] * radius[:, None, None]
        for row in range(3):
            placed[:, row, 3] = matrix[row, 3]
            for column in range(3):
                placed[:, row, 3] += matrix[row, column] * points[:, column]
        number = {int(level): self._sphere(int(level)) for level in np.unique(levels)}
        mesh = np.array([number[level] for level in levels.tolist()], np.int64)
        return Scatter(mesh=mesh, world_from_mesh=placed, holdout=holdout)

    def _visibility(
        self, rule: int, shown: bpy.types.Object, *, held_out: bool
    ) -> tuple[bool, bool]:
        """Whether a material's surface is there, and whether it holds out; never both."""
        rules = np.array([rule], np.int32)
        if self.alphas.find_rule(rule) is not None:
            self.warnings.add(
                f"object {shown.original.name!r} has hair or points whose alpha comes from an "
                f"image, an attribute or the side that is seen: {TAKEN_AS_OPAQUE}"
            )
        there, holdout = bool(self.alphas.is_there(rules)[0]), self.alphas.is_holdout(rules)[0]
        if held_out:
            return False, there or bool(holdout)
        return there, bool(holdout)

    def _by_settings(self) -> _Drawing:
        shape = self.curve_settings.shape
        if shape == "THICK":
            return round_tubes
        if shape == "THICK_LINEAR":
            return linear_tubes
        quads = min(_MOST_QUADS, (1 << min(self.curve_settings.subdivisions, 4)) + 1)
        return lambda strands, eye: ribbons(strands, eye, quads)

    def _eye(self, world_from_mesh: mathutils.Matrix) -> Eye | None:
        ortho_scale = self.camera.ortho_scale if self.camera.type == "ORTHO" else None
        return Eye.of(cam_from_mesh(self.camera, _rows(world_from_mesh))[0], ortho_scale)

    def _sphere(self, level: int) -> int:
        if level not in self._spheres:
            self._spheres[level] = self._add([sphere(level)], round_around_0=True)
        return self._spheres[level]

    def _add(self, parts: list[Triangulated], *, round_around_0: bool = False) -> int:
        """Keep parts as one mesh; `NO_MESH` when they have no triangle.

        round_around_0: its corners' normals are their positions; strands are flat.
        """
        vertices, triangles = parts[0] if len(parts) == 1 else join_meshes(parts)
        if not len(triangles):
            return NO_MESH
        self.has_thin_meshes = True
        self.meshes.append(
            CopiedMesh(
                vertices=vertices,
                triangles=triangles,
                cuts=None,
                corner_normal=vertices[triangles] if round_around_0 else None,
            )
        )
        return len(self.meshes) - 1


def _rows(matrix: mathutils.Matrix) -> NDArray[np.float64]:
    return np.array([matrix[0][:], matrix[1][:], matrix[2][:]], np.float64)[None]
