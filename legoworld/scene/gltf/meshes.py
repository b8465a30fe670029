"""Meshes as shown by their nodes: posed, cut out, the primitives of a mesh merged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.gltf.accessors import Accessors, as_float32
from legoworld.scene.gltf.buffers import Buffers
from legoworld.scene.gltf.cut_surfaces import CutSurfaces
from legoworld.scene.gltf.cutouts import Pictures
from legoworld.scene.gltf.draco import DracoMesh, decode
from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.nodes import Node, Tree
from legoworld.scene.gltf.pose import apply_morphs, apply_skin, default_weights, joint_matrices
from legoworld.scene.gltf.primitives import Primitive, Primitives, draco_payload, refuse_non_finite
from legoworld.scene.gltf.verdicts import Budget, unreadable
from legoworld.scene.triangle_cuts import TriangleCuts


@dataclass(frozen=True, kw_only=True)
class Part:
    """One primitive that shows a surface. vertices: (V, 3) float32; triangles: (T, 3) below V.

    normals: (V, 3) float32; None where the primitive is flat, or they were not asked for.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[Any]
    normals: NDArray[np.float32] | None
    shared: tuple[Any, ...]  # parts of a mesh with equal values have the same vertices
    cut: TriangleCuts | None


class Meshes:
    """The meshes shown by nodes, each built once. parts: per mesh of the snapshot."""

    def __init__(
        self,
        document: Fields,
        tree: Tree,
        buffers: Buffers,
        accessors: Accessors,
        budget: Budget,
        *,
        with_normals: bool,
    ) -> None:
        self._with_normals = with_normals
        self.parts: list[tuple[Part, ...]] = []
        self.pictures = Pictures(document, buffers, budget)
        self._document = document
        self._tree = tree
        self._accessors = accessors
        self._budget = budget
        self._meshes = document.children("meshes")
        self._skins = document.children("skins")
        used = sorted({node.mesh for node in tree.nodes if node.mesh >= 0 and node.visible})
        self._primitives = Primitives(document, accessors, self._draco(used, buffers), budget)
        self._surfaces = CutSurfaces(document, self._primitives, self.pictures, budget)
        self._mesh_numbers: dict[tuple[Any, ...], int] = {}
        self._joints: dict[int, NDArray[np.float64]] = {}

    @property
    def warnings(self) -> set[str]:
        """Warnings about what was ignored."""
        return self._primitives.warnings | self.pictures.warnings

    def index(self, node: Node) -> int:
        """The snapshot's index of a node's mesh; -1 if it shows no surface."""
        mesh = self._meshes[node.mesh]
        weights = default_weights(node.fields, mesh)
        key = (node.mesh, weights, node.skin)
        if key not in self._mesh_numbers:
            name = mesh.text("name") or node.name
            parts = tuple(
                part
                for primitive in mesh.children("primitives")
                if (part := self._part(primitive, name, weights, node.skin)) is not None
            )
            self._mesh_numbers[key] = len(self.parts) if parts else -1
            if parts:
                self.parts.append(parts)
        return self._mesh_numbers[key]

    def _draco(self, used: Iterable[int], buffers: Buffers) -> dict[str, DracoMesh]:
        primitives = [p for i in used for p in self._meshes[i].children("primitives")]
        payloads = [x for p in primitives if (x := draco_payload(p, buffers)) is not None]
        if not payloads:
            return {}
        decoded = decode(payloads, self._budget)
        return {p.place: mesh for p, mesh in zip(payloads, decoded, strict=True)}

    def _part(
        self, fields: Fields, mesh_name: str, weights: tuple[float, ...], skin: int
    ) -> Part | None:
        primitive = self._primitives.read(fields, mesh_name)
        if primitive is None:
            return None
        left = self._surfaces.cut(primitive)
        if left is None:
            return None
        triangles, cut = left
        posed = "targets" in fields or skin >= 0
        vertices, normals = primitive.positions, self._stored_normals(primitive)
        if posed:
            vertices, normals = self._pose_primitive(primitive, normals, weights, skin)
            refuse_non_finite(vertices, mesh_name)
        return Part(
            vertices=vertices,
            triangles=triangles,
            normals=normals,
            shared=(fields.place,) if posed else primitive.stored_as,
            cut=cut,
        )

    def _stored_normals(self, primitive: Primitive) -> NDArray[np.float32] | None:
        attributes = primitive.fields.child("attributes")
        if not self._with_normals or "NORMAL" not in attributes:
            return None
        stored = self._primitives.attribute(primitive.fields, "NORMAL")
        if stored.values.shape != primitive.positions.shape:
            raise attributes.wrong("NORMAL", "VEC3, one a vertex")
        self._budget.take(12 * len(stored.values), attributes.place)
        return as_float32(stored)

    def _pose_primitive(
        self,
        primitive: Primitive,
        normals: NDArray[np.float32] | None,
        weights: tuple[float, ...],
        skin: int,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        fields, accessors = primitive.fields, self._accessors
        positions = apply_morphs("POSITION", primitive.positions, fields, weights, accessors)
        if normals is not None:
            normals = apply_morphs("NORMAL", normals, fields, weights, accessors)
        attributes = primitive.fields.child("attributes")
        if skin < 0:
            return positions, normals
        if "JOINTS_0" not in attributes:
            raise attributes.wrong("JOINTS_0", "the joints of a mesh with a skin")
        if skin not in self._joints:
            self._joints[skin] = joint_matrices(
                self._skins[skin], self._tree.world_from_node, self._accessors
            )
        influences = []
        for n in range(len(attributes.values)):
            if f"JOINTS_{n}" not in attributes:
                break
            if f"WEIGHTS_{n}" not in attributes:
                raise attributes.wrong(f"WEIGHTS_{n}", "the weights of the joints")
            joints = self._primitives.attribute(primitive.fields, f"JOINTS_{n}").values
            stored = self._primitives.attribute(primitive.fields, f"WEIGHTS_{n}")
            shape = (len(positions), 4)
            if joints.shape != shape or stored.values.shape != shape or joints.dtype.kind != "u":
                raise unreadable(f"{attributes.place}: joints and weights are not VEC4 a vertex")
            self._budget.take(4 * len(positions) * 24, "joints and weights")
            influences.append((joints.astype(np.int64), as_float32(stored)))
        return apply_skin(positions, normals, influences, self._joints[skin], self._budget)
