"""Triangles of evaluated meshes, by the fastest documented accessors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.blender.corner_triangles import triangle_corners
from legoworld.scene.triangle_cuts import TriangleCuts

if TYPE_CHECKING:
    import bpy


@dataclass(frozen=True, kw_only=True)
class Triangles:
    """The triangles of one mesh.

    vertices: (T, 3) int32. corners: (T, 3) int32, the face corners they use, for reading what is
    stored per corner; those of `mesh_triangles` only until the mesh changes.
    """

    vertices: NDArray[np.int32]
    corners: NDArray[np.int32]

    def select(self, keep: NDArray[np.bool_]) -> Self:
        """Those triangles only."""
        return type(self)(vertices=self.vertices[keep], corners=self.corners[keep])


@dataclass(kw_only=True)
class CopiedMesh:
    """One mesh as it shows, in its own frame: faces that alpha removes are left out.

    vertices: (V, 3) float32; triangles: (T, 3) int32. cuts: by the
    cuts of the walk's `AlphaTable`, None where no triangle has one.
    corner_normal: (T, 3, 3) float32, 0 of flat triangles; None where all are flat, or not asked.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    cuts: TriangleCuts | None
    corner_normal: NDArray[np.float32] | None = None


def mesh_vertices(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """(V, 3) float32 positions of an evaluated bpy.types.Mesh, in its own frame."""
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    if len(vertices):
        mesh.attributes["position"].data.foreach_get("vector", vertices.ravel())
    return vertices


def mesh_triangles(mesh: bpy.types.Mesh) -> Triangles:
    """The triangles of an evaluated bpy.types.Mesh; n-gons are divided as Blender draws them."""
    n_corners = len(mesh.loops)
    corner_vertex = np.empty(n_corners, np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", corner_vertex)
    if _all_triangles(mesh):
        corners = np.arange(n_corners, dtype=np.int32).reshape(-1, 3)
        return Triangles(vertices=corner_vertex.reshape(-1, 3), corners=corners)
    mesh.calc_loop_triangles()
    corners = triangle_corners(mesh)
    return Triangles(vertices=corner_vertex.take(corners), corners=corners)


def triangle_materials(mesh: bpy.types.Mesh) -> NDArray[np.int32]:
    """(T,) int32, the material slot of each triangle, in the order of `mesh_triangles`."""
    material = np.zeros(len(mesh.polygons), np.int32)
    attribute = mesh.attributes.get("material_index")
    if attribute is not None and attribute.domain == "FACE":
        attribute.data.foreach_get("value", material)
    if _all_triangles(mesh):
        return material
    mesh.calc_loop_triangles()
    face = np.empty(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangle_polygons.foreach_get("value", face)
    of_triangle: NDArray[np.int32] = material[face]
    return of_triangle


def corner_normals(mesh: bpy.types.Mesh, corners: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """(T, 3, 3) float32 normals at triangles' corners, as Cycles shades them; None: all are flat.

    Custom normals and sharp edges are in them. Faces that are not smooth have 0: Cycles gives them
    the normals of their triangles. corners: (T, 3) of `Triangles`.
    """
    if mesh.normals_domain == "FACE":
        return None
    normals = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", normals.ravel())
    sharp = mesh.attributes.get("sharp_face")
    if sharp is not None and sharp.domain == "FACE":
        flat, corners_of = np.empty(len(mesh.polygons), bool), np.empty(len(mesh.polygons), int)
        sharp.data.foreach_get("value", flat)
        mesh.polygons.foreach_get("loop_total", corners_of)
        normals[np.repeat(flat, corners_of)] = 0.0
    chosen: NDArray[np.float32] = normals[corners]
    return chosen


def corner_uv(
    mesh: bpy.types.Mesh, name: str | None, corners: NDArray[np.int32]
) -> NDArray[np.float32] | None:
    """(T, 3, 2) float32 texture coordinates of a UV map; None when the mesh does not have it.

    name None means the map a render uses by default.
    """
    layers = mesh.uv_layers
    if name is None:
        layer = next((x for x in layers if x.active_render), None)
    else:
        layer = layers.get(name)
    if layer is None:
        return None
    uv = np.empty((len(mesh.loops), 2), np.float32)
    layer.uv.foreach_get("vector", uv.ravel())
    chosen: NDArray[np.float32] = uv[corners]
    return chosen


def transform_uv(
    uv: NDArray[np.float32], transform: tuple[float, float, float, float, float, float]
) -> NDArray[np.float32]:
    """(..., 2) texture coordinates after u' = a*u + b*v + c, v' = d*u + e*v + f."""
    a, b, c, d, e, f = transform
    u, v = uv[..., 0].astype(np.float64), uv[..., 1].astype(np.float64)
    return np.stack([a * u + b * v + c, d * u + e * v + f], axis=-1, dtype=np.float32)


def _all_triangles(mesh: bpy.types.Mesh) -> bool:
    return len(mesh.loops) == 3 * len(mesh.polygons)
